// Cluster projection as fast as we can: blocks of rows, vectors of columns, fused channels.
// Macros: STORAGE, VEC, VECTORS (vectors per probe and row), STRIDE (of lambda, in floats), SHARE
// (blocks of one work-group, whatever its size: enough groups for all cores to take turns).
#include "common/vec.cl"
#include "srp/storage.cl"

// The products of COUNT rows of one cluster with lambda. The rows are interleaved vector by vector,
// so that a work-item reads one stream from start to end, and each vector of lambda read serves
// COUNT rows. Three channels times COUNT rows of accumulators stay in registers.
#define PROJECT_ROWS(COUNT)                                                                  \
    inline void project_##COUNT(__global const stored_t *value, __global const int *probe,   \
                                int probes, __global const float *lambda,                    \
                                __global const float *scale, __global float *basis)          \
    {                                                                                        \
        vfloat r[COUNT], g[COUNT], b[COUNT];                                                 \
        _Pragma("unroll") for (int i = 0; i < COUNT; ++i)                                    \
            r[i] = g[i] = b[i] = (vfloat)(0.0f);                                             \
        for (int p = 0; p < probes; ++p) {                                                   \
            __global const float *light = lambda + (size_t)probe[p] * 3 * STRIDE;            \
            _Pragma("unroll") for (int v = 0; v < VECTORS; ++v)                              \
            {                                                                                \
                FETCH_AHEAD(value, COUNT * VEC * sizeof(stored_t))                               \
                const vfloat red = float_vector(v, light);                                       \
                const vfloat green = float_vector(v, light + STRIDE);                            \
                const vfloat blue = float_vector(v, light + 2 * STRIDE);                         \
                _Pragma("unroll") for (int i = 0; i < COUNT; ++i)                            \
                {                                                                            \
                    const vfloat m = stored_vector(i, value);                                \
                    r[i] += m * red;                                                         \
                    g[i] += m * green;                                                       \
                    b[i] += m * blue;                                                        \
                }                                                                            \
                value += COUNT * VEC;                                                        \
            }                                                                                \
        }                                                                                    \
        _Pragma("unroll") for (int i = 0; i < COUNT; ++i)                                    \
            store3(basis, i, scale[i] * (float3)(lane_sum(r[i]), lane_sum(g[i]), lane_sum(b[i]))); \
    }

PROJECT_ROWS(1)
PROJECT_ROWS(2)
PROJECT_ROWS(3)
PROJECT_ROWS(4)

// A block's row of `blocks`, BLOCK_INTS ints.
#define BLOCK_INTS 5
#define FIRST_VALUE 0 // in vectors of VEC
#define FIRST_ROW 1   // of the light basis vectors
#define ROWS 2        // 1 to 4
#define FIRST_PROBE 3 // in `probes`
#define PROBES 4

// cluster_projection: one work-item per block of up to four rows of one cluster.
//   basis[row] = scale[row] * sum over the cluster's probes and their coefficients of
//                projection[row][probe, coefficient] * lambda[probe][coefficient]
//   probes  the clusters' probes      lambda  (probes, 3, STRIDE)
//   scale   (rows,)                   basis   (rows, 3) the light basis vectors of all clusters
__kernel void cluster_projection(__global const int *blocks, int count,
                                 __global const int *probes, __global const stored_t *projection,
                                 __global const float *scale, __global const float *lambda,
                                 __global float *basis)
{
    const int first = (int)get_group_id(0) * SHARE;
    const int last = first + SHARE < count ? first + SHARE : count;
    for (int i = first + (int)get_local_id(0); i < last; i += (int)get_local_size(0)) {
        __global const int *block = blocks + BLOCK_INTS * i;
        __global const stored_t *value = projection + (size_t)block[FIRST_VALUE] * VEC;
        __global const int *probe = probes + block[FIRST_PROBE];
        __global const float *factor = scale + block[FIRST_ROW];
        __global float *out = basis + 3 * (size_t)block[FIRST_ROW];
        if (block[ROWS] == 4)
            project_4(value, probe, block[PROBES], lambda, factor, out);
        else if (block[ROWS] == 3)
            project_3(value, probe, block[PROBES], lambda, factor, out);
        else if (block[ROWS] == 2)
            project_2(value, probe, block[PROBES], lambda, factor, out);
        else
            project_1(value, probe, block[PROBES], lambda, factor, out);
    }
}
