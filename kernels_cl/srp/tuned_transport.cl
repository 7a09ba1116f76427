// Irradiance transport as fast as we can: vectors of receivers, fused channels.
// Macros: STORAGE, VEC; COMPONENTS of the light at a receiver.
#include "common/vec.cl"
#include "srp/storage.cl"

// A block's row of `blocks`, BLOCK_INTS ints.
#define BLOCK_INTS 3
#define FIRST_VALUE 0 // in vectors of VEC
#define FIRST_ROW 1   // of the light basis vectors
#define ROWS 2        // light basis vectors

// irradiance_transport: one work-item per VEC receivers of one cluster.
//   component[receiver] = sum over light basis vectors of
//                         reconstruction[j, component][receiver] * basis[j]
// The reconstruction matrix is transposed: VEC receivers side by side, component after component and
// one light basis vector after the other, so that no lanes need adding up and a vector that is read
// serves all components.
//   texel     (count * VEC,) of the receivers; -1 where a cluster's last vector is not full
//   indirect  lightmap of the signal (common/lightmap.cl), W/m2
__kernel void irradiance_transport(__global const int *blocks, int count,
                                   __global const stored_t *reconstruction,
                                   __global const int *texel, __global const float *basis,
                                   __global float4 *indirect)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    __global const int *block = blocks + BLOCK_INTS * i;
    __global const stored_t *value = reconstruction + (size_t)block[FIRST_VALUE] * VEC;
    __global const float *light = basis + 3 * (size_t)block[FIRST_ROW];
    vfloat r[COMPONENTS], g[COMPONENTS], b[COMPONENTS];
#pragma unroll
    for (int c = 0; c < COMPONENTS; ++c)
        r[c] = g[c] = b[c] = (vfloat)(0.0f);
    const int rows = block[ROWS];
    for (int j = 0; j < rows; ++j) {
#pragma unroll
        for (int c = 0; c < COMPONENTS; ++c) {
            const vfloat m = stored_vector(COMPONENTS * j + c, value);
            r[c] += m * light[3 * j];
            g[c] += m * light[3 * j + 1];
            b[c] += m * light[3 * j + 2];
        }
    }
#pragma unroll
    for (int k = 0; k < VEC; ++k) {
        const int at = texel[i * VEC + k];
        if (at < 0)
            continue;
        __global float4 *out = indirect + (size_t)COMPONENTS * at;
#pragma unroll
        for (int c = 0; c < COMPONENTS; ++c) {
            const float *red = (const float *)&r[c], *green = (const float *)&g[c];
            const float *blue = (const float *)&b[c];
            out[c] = (float4)(red[k], green[k], blue[k], 1.0f);
        }
    }
}
