// Cluster projection for devices that run work-items in lockstep: a work-item per row, neighbours on
// neighbouring rows, no barrier and no local memory.
// Macros: STORAGE, FETCHES (srp/storage.cl), COEFFICIENTS (of a probe), TEAM (the work-group's size: rows of a
// tile).
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
#define WHOLE (-1)

// Words of a probe and row.
#define PROBE_STEPS ((COEFFICIENTS + 1) / 2 * PAIR_WORDS)

// cluster_projection: one work-item per row of a tile, one work-group per piece of its columns.
//   sum[row] = sum over the piece's probes and their coefficients of
//              projection[row][probe, coefficient] * lambda[probe][coefficient]
// Two columns a step, for each of which all work-items read the same three floats of lambda. Where a
// step's words end the next step's begin: neighbours' words fill whole cache lines, and work-items
// behind the last row read what the next step reads anyway (behind the matrix there is room).
//   probes   the clusters' probes      lambda  (probes, 3, COEFFICIENTS)
//   partial  (slots, 3, TEAM) sums of pieces that are not whole tiles
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
    const int count = piece[PROBES], stride = piece[STRIDE];
    if (item >= (size_t)piece[ITEMS])
        return;
    float red = 0.0f, green = 0.0f, blue = 0.0f, red1 = 0.0f, green1 = 0.0f, blue1 = 0.0f;
    for (int p = 0; p < count; ++p) {
        __global const float *light = lambda + (size_t)probe[p] * 3 * COEFFICIENTS;
        __global const word_t *step = words + (size_t)(p * PROBE_STEPS * stride);
        for (int j = 0; j < COEFFICIENTS / 2; ++j) {
            // All lines of a step; for all work-items of a vector at once, as the address is theirs.
            FETCH_AHEAD(step + j * PAIR_WORDS * stride, 2 * CACHE_LINE)
            const pair_t pair = pair_at(step, j, stride, item);
            const float m = pair_first(pair), n = pair_second(pair);
            red += m * light[2 * j];
            green += m * light[COEFFICIENTS + 2 * j];
            blue += m * light[2 * COEFFICIENTS + 2 * j];
            red1 += n * light[2 * j + 1];
            green1 += n * light[COEFFICIENTS + 2 * j + 1];
            blue1 += n * light[2 * COEFFICIENTS + 2 * j + 1];
        }
#if COEFFICIENTS % 2
        const float m = pair_first(pair_at(step, COEFFICIENTS / 2, stride, item));
        red += m * light[COEFFICIENTS - 1];
        green += m * light[2 * COEFFICIENTS - 1];
        blue += m * light[3 * COEFFICIENTS - 1];
#endif
    }
    red += red1;
    green += green1;
    blue += blue1;
    if (piece[SLOT] == WHOLE) {
        if (item < (size_t)piece[ROWS]) {
            const float factor = (scale + piece[FIRST_ROW])[item];
            vstore4((float4)(red * factor, green * factor, blue * factor, 0.0f), item,
                    basis + 4 * (size_t)piece[FIRST_ROW]);
        }
        return;
    }
    __global float *sums = partial + (size_t)piece[SLOT] * (3 * TEAM);
    sums[item] = red;
    sums[TEAM + item] = green;
    sums[2 * TEAM + item] = blue;
}

// A tile's row of `row_tiles`, ROW_TILE_INTS ints.
#define ROW_TILE_INTS 4
#define TILE_ROW 0 // the first, of the light basis vectors
#define TILE_ROWS 1
#define FIRST_SLOT 2 // in `partial`
#define SLOTS 3

// add_pieces: one work-item per row of a tile, one work-group per tile of more than one piece.
//   basis[row] = scale[row] * sum over the tile's slots of partial[slot][row]
//   scale (rows,)      basis (rows, 4) the light basis vectors of all clusters, the fourth 0
__kernel void add_pieces(__global const int *row_tiles, __global const float *partial,
                         __global const float *scale, __global float *basis)
{
    const size_t item = get_local_id(0);
    __global const int *tile = row_tiles + ROW_TILE_INTS * get_group_id(0);
    __global const float *sums = partial + (size_t)tile[FIRST_SLOT] * (3 * TEAM);
    const int slots = tile[SLOTS];
    if (item >= (size_t)tile[TILE_ROWS])
        return;
    float red = 0.0f, green = 0.0f, blue = 0.0f;
    for (int k = 0; k < slots; ++k) {
        red += sums[(size_t)(3 * k * TEAM) + item];
        green += sums[(size_t)((3 * k + 1) * TEAM) + item];
        blue += sums[(size_t)((3 * k + 2) * TEAM) + item];
    }
    const float factor = (scale + tile[TILE_ROW])[item];
    vstore4((float4)(red * factor, green * factor, blue * factor, 0.0f), item,
            basis + 4 * (size_t)tile[TILE_ROW]);
}
