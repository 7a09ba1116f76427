// Cluster projection for devices that run work-items in lockstep: a work-group per block of rows,
// neighbours on neighbouring columns, sums added up in local memory.
// Macros: STORAGE, COEFFICIENTS (of a probe), TEAM (the work-group's size), BLOCK_ROWS (rows of a
// block at most), ROW_UNIT (values in ROW_BYTES).
#define VEC 1
#include "common/vec.cl"
#include "srp/storage.cl"

// A block's row of `blocks`, BLOCK_INTS ints.
#define BLOCK_INTS 5
#define FIRST_VALUE 0 // in units of ROW_UNIT values: every row begins a cache line
#define FIRST_ROW 1   // of the light basis vectors
#define ROWS 2        // 1 to BLOCK_ROWS
#define FIRST_PROBE 3 // in `probes`
#define PROBES 4

#define SUMS (3 * BLOCK_ROWS)

// Adds a column's products. Rows that a block lacks are its last one again; nobody stores them.
inline void add_column(float *sums, __global const float *light, __global const stored_t *value,
                       int stride, int rows)
{
    const float red = light[0], green = light[COEFFICIENTS], blue = light[2 * COEFFICIENTS];
#pragma unroll
    for (int k = 0; k < BLOCK_ROWS; ++k) {
        const float m = stored_value(value + min(k, rows - 1) * stride);
        sums[3 * k] += m * red;
        sums[3 * k + 1] += m * green;
        sums[3 * k + 2] += m * blue;
    }
}

// cluster_projection: one work-group per block of up to BLOCK_ROWS rows of one cluster.
//   basis[row] = scale[row] * sum over the cluster's probes and their coefficients of
//                projection[row][probe, coefficient] * lambda[probe][coefficient]
// A value of lambda that is read serves all rows of the block.
//   probes  the clusters' probes      lambda  (probes, 3, COEFFICIENTS)
//   scale   (rows,)                   basis   (rows, 3) the light basis vectors of all clusters
//   partial local, SUMS * TEAM floats
__kernel void cluster_projection(__global const int *blocks, __global const int *probes,
                                 __global const stored_t *projection,
                                 __global const float *scale, __global const float *lambda,
                                 __global float *basis, __local float *partial)
{
    const int item = get_local_id(0);
    __global const int *block = blocks + BLOCK_INTS * get_group_id(0);
    const int first = block[FIRST_ROW], rows = block[ROWS];
    const int columns = block[PROBES] * COEFFICIENTS;
    const int stride = (columns + ROW_UNIT - 1) / ROW_UNIT * ROW_UNIT;
    __global const stored_t *value = projection + (size_t)block[FIRST_VALUE] * ROW_UNIT;
    __global const int *probe = probes + block[FIRST_PROBE];
    float sums[SUMS];
#pragma unroll
    for (int k = 0; k < SUMS; ++k)
        sums[k] = 0.0f;
#if COEFFICIENTS % TEAM == 0
    // All work-items are in the same probe: a compiler that makes vectors of work-items sees that
    // they read neighbouring addresses.
    for (int p = 0; p < block[PROBES]; ++p) {
        __global const float *light = lambda + (size_t)probe[p] * 3 * COEFFICIENTS;
        for (int j = item; j < COEFFICIENTS; j += TEAM)
            add_column(sums, light + j, value + p * COEFFICIENTS + j, stride, rows);
    }
#else
    for (int c = item; c < columns; c += TEAM) {
        __global const float *light = lambda + (size_t)probe[c / COEFFICIENTS] * 3 * COEFFICIENTS;
        add_column(sums, light + c % COEFFICIENTS, value + c, stride, rows);
    }
#endif
#pragma unroll
    for (int k = 0; k < SUMS; ++k)
        partial[k * TEAM + item] = sums[k];
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int left = TEAM; left > 1; left = (left + 1) / 2) {
        const int upper = (left + 1) / 2;
        if (item + upper < left) {
#pragma unroll
            for (int k = 0; k < SUMS; ++k)
                partial[k * TEAM + item] += partial[k * TEAM + item + upper];
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    for (int k = item; k < 3 * rows; k += TEAM)
        basis[3 * (size_t)first + k] = scale[first + k / 3] * partial[k * TEAM];
}
