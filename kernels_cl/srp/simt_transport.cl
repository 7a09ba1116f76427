// Irradiance transport for devices that run work-items in lockstep: a work-group per tile of
// receivers, one each, neighbours on neighbouring values.
// Macros: STORAGE, FETCHES (srp/storage.cl); COMPONENTS of the light at a receiver; TEAM (work-items of
// a group that compute); TILES (tiles of a group) and VECTOR=1, where a CPU makes vectors of work-items:
// one of them computes then and takes a tile's receivers in turns, as many small groups cost more
// than what they compute.
#define VEC 1
#include "common/vec.cl"
#include "srp/storage.cl"

// A tile's row of `tiles`, TILE_INTS ints.
#define TILE_INTS 6
#define FIRST_WORD 0  // of the matrix
#define FIRST_ROW 1   // of the light basis vectors
#define ROWS 2        // light basis vectors
#define STRIDE 3      // words of a step: the tile's receivers
#define ITEMS 4       // work-items' turns: the receivers, and those that fill the device's last vector
#define FIRST_TEXEL 5 // in `texel`

// irradiance_transport: one work-item per receiver, one work-group per tile, or per TILES of them whose
// receivers are taken in turns.
//   component[receiver] = sum over light basis vectors of
//                         reconstruction[j, component][receiver] * basis[j]
// The reconstruction matrix is transposed within tiles: of each component one pair of light basis
// vectors after the other (srp/storage.cl), the receivers side by side. A tile is one group's, so
// that all its work-items loop alike and read the same floats of `basis`. Where VECTOR, work-items behind
// the last receiver read what the next step reads anyway (behind the matrix there is room): no test
// stands within the loops.
//   tiles     of whole groups; ITEMS of those behind the last is 0
//   basis     (rows, 4)
//   texel     of the receivers, tile after tile; -1 where a work-item has none
//   indirect  lightmap of the signal (common/lightmap.cl), W/m2
__kernel void irradiance_transport(__global const int *tiles,
                                   __global const word_t *reconstruction,
                                   __global const int *texel, __global const float *basis,
                                   __global float *indirect)
{
    // Not an int: see srp/simt_projection.cl.
    const size_t lane = get_local_id(0);
    if (lane >= TEAM)
        return;
    for (int t = 0; t < TILES; ++t) {
        __global const int *tile = tiles + TILE_INTS * ((int)get_group_id(0) * TILES + t);
        __global const float *light = basis + 4 * (size_t)tile[FIRST_ROW];
        const int rows = tile[ROWS], stride = tile[STRIDE], items = tile[ITEMS];
        const int component_words = (rows + 1) / 2 * (PAIR_WORDS * stride);
        for (int first = 0; first < items; first += TEAM) {
#if !VECTOR
            if (lane >= (size_t)(items - first))
                continue;
#endif
            __global const word_t *words = reconstruction + (tile[FIRST_WORD] + first);
            const int at = (texel + (tile[FIRST_TEXEL] + first))[lane];
            for (int c = 0; c < COMPONENTS; ++c) {
                __global const word_t *step = words + (size_t)(c * component_words);
                float red = 0.0f, green = 0.0f, blue = 0.0f;
                float red1 = 0.0f, green1 = 0.0f, blue1 = 0.0f;
#if VECTOR && defined(__clang__)
                // Texels lie anywhere in the map: their lines come while the sums are computed.
                __builtin_prefetch(indirect + 4 * ((size_t)COMPONENTS * max(at, 0) + c), 1, 3);
#endif
                for (int j = 0; j < rows / 2; ++j) {
                    FETCH_AHEAD(step + j * PAIR_WORDS * stride, 2 * CACHE_LINE)
                    const pair_t pair = pair_at(step, j, stride, lane);
                    const float m = pair_first(pair), n = pair_second(pair);
                    red += m * light[8 * j];
                    green += m * light[8 * j + 1];
                    blue += m * light[8 * j + 2];
                    red1 += n * light[8 * j + 4];
                    green1 += n * light[8 * j + 5];
                    blue1 += n * light[8 * j + 6];
                }
                if (rows % 2) {
                    const float m = pair_first(pair_at(step, rows / 2, stride, lane));
                    red += m * light[4 * rows - 4];
                    green += m * light[4 * rows - 3];
                    blue += m * light[4 * rows - 2];
                }
                // One store of 16 bytes each. An assignment is taken apart into a scatter of floats
                // where vectors are made of work-items.
                if (at >= 0)
                    vstore4((float4)(red + red1, green + green1, blue + blue1, 1.0f),
                            (size_t)COMPONENTS * at + c, indirect);
            }
        }
    }
}
