// Cluster projection and irradiance transport as published (Bennett 2019, section 5.3).
// Macros: STORAGE; COMPONENTS of the light at a receiver.
#include "common/vec.cl"
#include "srp/storage.cl"

// A cluster's row of `clusters`, CLUSTER_INTS ints.
#define CLUSTER_INTS 5
#define FIRST_ROW 0         // of the light basis vectors
#define ROWS 1              // light basis vectors
#define FIRST_COLUMN 2      // of the column-index buffer
#define COLUMNS 3           // stored, non-zero columns
#define FIRST_PROJECTION 4  // value of the projection matrix; row-major

// cluster_projection: one work-item per matrix row, over the stored columns.
//   basis[row] = scale[row] * sum over columns of projection[row][column] * lambda[column's index]
//   row_cluster  (rows,)       columns  stored column -> index into lambda, in coefficients
//   lambda       (probes * coefficients, 3)
//   scale        (rows,) the factors that storage took out of projection row and reconstruction
//                column
//   basis        (rows, 3) the light basis vectors l of all clusters
__kernel void cluster_projection(__global const int *clusters, __global const int *row_cluster,
                                 __global const int *columns, __global const stored_t *projection,
                                 __global const float *scale, __global const float *lambda,
                                 int rows, __global float *basis)
{
    const int row = get_global_id(0);
    if (row >= rows)
        return;
    __global const int *c = clusters + CLUSTER_INTS * row_cluster[row];
    const int count = c[COLUMNS];
    __global const int *column = columns + c[FIRST_COLUMN];
    __global const stored_t *value =
        projection + c[FIRST_PROJECTION] + (size_t)(row - c[FIRST_ROW]) * count;
    float3 sum = (float3)(0.0f);
    for (int i = 0; i < count; ++i)
        sum += stored_scalar(value + i) * load3(lambda, column[i]);
    store3(basis, row, sum * scale[row]);
}

// irradiance_transport: one work-item per receiver.
//   component = sum over light basis vectors of reconstruction[receiver, component][j] * basis[j]
//   receiver_cluster, first_value, texel  per receiver in cluster order: its cluster, where its rows
//                                         of the reconstruction matrix start, its texel
//   indirect                              lightmap of the signal (common/lightmap.cl), W/m2
__kernel void irradiance_transport(__global const int *clusters,
                                   __global const int *receiver_cluster,
                                   __global const stored_t *reconstruction,
                                   __global const int *first_value, __global const int *texel,
                                   __global const float *basis, int receivers,
                                   __global float4 *indirect)
{
    const int i = get_global_id(0);
    if (i >= receivers)
        return;
    __global const int *c = clusters + CLUSTER_INTS * receiver_cluster[i];
    __global const stored_t *value = reconstruction + first_value[i];
    __global float4 *out = indirect + (size_t)COMPONENTS * texel[i];
    const int rows = c[ROWS];
    for (int component = 0; component < COMPONENTS; ++component, value += rows) {
        float3 sum = (float3)(0.0f);
        for (int j = 0; j < rows; ++j)
            sum += stored_scalar(value + j) * load3(basis, c[FIRST_ROW] + j);
        out[component] = (float4)(sum, 1.0f);
    }
}
