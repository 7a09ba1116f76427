// Cluster projection for devices that run work-items in lockstep: a work-item per row, neighbours on
// neighbouring rows, no barrier and no local memory.
// Macros: STORAGE, FETCHES (srp/storage.cl), COEFFICIENTS (of a probe), TEAM (work-items of a
// group that compute), EACH (rows of a work-item, TEAM apart: 1 or 2; a tile has TEAM * EACH rows at most),
// WHOLE (a slot that there is not).
//
// Where clusters are few they fill no GPU, so the columns of a tile are cut into pieces of some probes,
// a work-group each; a second kernel adds their sums up. Where a tile is one piece, there is nothing to
// add. A cluster has up to 32 rows: a wave of 64 works with half of its lanes, and waits for memory all
// the same.
#define VEC 1
#include "common/vec.cl"
#include "srp/storage.cl"

// A piece's row of `pieces`, PIECE_INTS ints.
#define PIECE_INTS 8
#define FIRST_WORD 0  // of the matrix
#define FIRST_PROBE 1 // in `probes`
#define PROBES 2
#define STRIDE 3    // words of a step: the tile's rows
#define ITEMS 4     // work-items that compute: the rows, and those that fill the device's last vector
#define FIRST_ROW 5 // of the light basis vectors
#define ROWS 6      // of the tile
#define SLOT 7      // in `partial`; WHOLE where the piece is all of its tile

#define TILE_ROWS (TEAM * EACH)

// Words of a probe and row.
#define PROBE_STEPS ((COEFFICIENTS + 1) / 2 * PAIR_WORDS)

// The sums of COUNT rows of a work-item, by which a float of lambda that is read serves COUNT rows.
#define PROJECT(COUNT)                                                                             \
    inline void project_##COUNT(__global const word_t *words, __global const int *probe,           \
                                __global const float *lambda, __global const float *scale,         \
                                __global float *partial, __global float *basis,                    \
                                __global const int *piece, size_t item)                            \
    {                                                                                              \
        const int count = piece[PROBES], stride = piece[STRIDE];                                   \
        float red[COUNT], green[COUNT], blue[COUNT], red1[COUNT], green1[COUNT], blue1[COUNT];     \
        _Pragma("unroll") for (int k = 0; k < COUNT; ++k)                                          \
            red[k] = green[k] = blue[k] = red1[k] = green1[k] = blue1[k] = 0.0f;                   \
        for (int p = 0; p < count; ++p) {                                                          \
            __global const float *light = lambda + (size_t)probe[p] * 3 * COEFFICIENTS;            \
            __global const word_t *step = words + (size_t)(p * PROBE_STEPS * stride);              \
            for (int j = 0; j < COEFFICIENTS / 2; ++j) {                                           \
                FETCH_AHEAD(step + j * PAIR_WORDS * stride, 2 * CACHE_LINE)                        \
                _Pragma("unroll") for (int k = 0; k < COUNT; ++k)                                  \
                {                                                                                  \
                    const pair_t pair = pair_at(step + k * TEAM, j, stride, item);                 \
                    const float m = pair_first(pair), n = pair_second(pair);                       \
                    red[k] += m * light[2 * j];                                                    \
                    green[k] += m * light[COEFFICIENTS + 2 * j];                                   \
                    blue[k] += m * light[2 * COEFFICIENTS + 2 * j];                                \
                    red1[k] += n * light[2 * j + 1];                                               \
                    green1[k] += n * light[COEFFICIENTS + 2 * j + 1];                              \
                    blue1[k] += n * light[2 * COEFFICIENTS + 2 * j + 1];                           \
                }                                                                                  \
            }                                                                                      \
            if (COEFFICIENTS % 2) {                                                                \
                _Pragma("unroll") for (int k = 0; k < COUNT; ++k)                                  \
                {                                                                                  \
                    const float m =                                                                \
                        pair_first(pair_at(step + k * TEAM, COEFFICIENTS / 2, stride, item));      \
                    red[k] += m * light[COEFFICIENTS - 1];                                         \
                    green[k] += m * light[2 * COEFFICIENTS - 1];                                   \
                    blue[k] += m * light[3 * COEFFICIENTS - 1];                                    \
                }                                                                                  \
            }                                                                                      \
        }                                                                                          \
        _Pragma("unroll") for (int k = 0; k < COUNT; ++k)                                          \
        {                                                                                          \
            red[k] += red1[k];                                                                     \
            green[k] += green1[k];                                                                 \
            blue[k] += blue1[k];                                                                   \
            if (piece[SLOT] != WHOLE) {                                                            \
                __global float *sums = partial + (size_t)piece[SLOT] * (3 * TILE_ROWS) + k * TEAM; \
                sums[item] = red[k];                                                               \
                sums[TILE_ROWS + item] = green[k];                                                 \
                sums[2 * TILE_ROWS + item] = blue[k];                                              \
            } else if (item + k * TEAM < (size_t)piece[ROWS]) {                                    \
                const float factor = (scale + piece[FIRST_ROW] + k * TEAM)[item];                  \
                vstore4((float4)(red[k] * factor, green[k] * factor, blue[k] * factor, 0.0f),      \
                        item, basis + 4 * (size_t)(piece[FIRST_ROW] + k * TEAM));                  \
            }                                                                                      \
        }                                                                                          \
    }

PROJECT(1)
#if EACH == 2
PROJECT(2)
#endif

// cluster_projection: one work-item per EACH rows of a tile, one work-group per piece of its columns.
//   sum[row] = sum over the piece's probes and their coefficients of
//              projection[row][probe, coefficient] * lambda[probe][coefficient]
// Two columns a step, for each of which all work-items read the same three floats of lambda. Where a
// step's words end the next step's begin: neighbours' words fill whole cache lines, and work-items
// behind the last row read what the next step reads anyway (behind the matrix there is room).
//   probes   the clusters' probes      lambda  (probes, 3, COEFFICIENTS)
//   partial  (slots, 3, TILE_ROWS) sums of pieces that are not whole tiles
//   basis    (rows, 4) scale[row] * sum[row] of those that are, the fourth 0
__kernel void cluster_projection(__global const int *pieces, __global const int *probes,
                                 __global const word_t *projection,
                                 __global const float *scale, __global const float *lambda,
                                 __global float *partial, __global float *basis)
{
    // Not an int: a compiler that makes vectors of work-items must know that neighbours' addresses
    // are neighbours, which a sum of ints that may wrap around does not say.
    const size_t item = get_local_id(0);
    __global const int *piece = pieces + PIECE_INTS * get_group_id(0);
    __global const word_t *words = projection + piece[FIRST_WORD];
    __global const int *probe = probes + piece[FIRST_PROBE];
    if (item >= (size_t)piece[ITEMS])
        return;
#if EACH == 2
    if (piece[ROWS] > TEAM) {
        project_2(words, probe, lambda, scale, partial, basis, piece, item);
        return;
    }
#endif
    project_1(words, probe, lambda, scale, partial, basis, piece, item);
}

// A tile's row of `row_tiles`, ROW_TILE_INTS ints.
#define ROW_TILE_INTS 4
#define OF_ROW 0 // the first, of the light basis vectors
#define OF_ROWS 1
#define FIRST_SLOT 2 // in `partial`
#define SLOTS 3

// add_pieces: one work-item per EACH rows of a tile, one work-group per tile of more than one piece.
//   basis[row] = scale[row] * sum over the tile's slots of partial[slot][row]
//   scale (rows,)      basis (rows, 4) the light basis vectors of all clusters, the fourth 0
__kernel void add_pieces(__global const int *row_tiles, __global const float *partial,
                         __global const float *scale, __global float *basis)
{
    const size_t item = get_local_id(0);
    __global const int *tile = row_tiles + ROW_TILE_INTS * get_group_id(0);
    const int slots = tile[SLOTS], rows = tile[OF_ROWS];
    if (item >= TEAM)
        return;
#pragma unroll
    for (int turn = 0; turn < TILE_ROWS; turn += TEAM) {
        __global const float *sums = partial + (size_t)tile[FIRST_SLOT] * (3 * TILE_ROWS) + turn;
        float red = 0.0f, green = 0.0f, blue = 0.0f;
        for (int k = 0; k < slots; ++k) {
            red += sums[(size_t)(3 * k * TILE_ROWS) + item];
            green += sums[(size_t)((3 * k + 1) * TILE_ROWS) + item];
            blue += sums[(size_t)((3 * k + 2) * TILE_ROWS) + item];
        }
        if (item + turn < (size_t)rows) {
            const int first = tile[OF_ROW] + turn;
            const float factor = (scale + first)[item];
            vstore4((float4)(red * factor, green * factor, blue * factor, 0.0f), item,
                    basis + 4 * (size_t)first);
        }
    }
}
