// The caches' light from their links where work-items run in lockstep: a group for each cache, whose
// work-items are its links, so that neighbours read neighbouring halves. Each keeps the sums of its
// links; the group adds them up in local memory. Links lie as for tuned_cache_lighting.cl. Macros: those
// of links.cl.
#include "surfel_cache/caps.cl"
#include "surfel_cache/links.cl"

// A half by integer operations: some compilers call a function for vload_half. Sign to bit 31, exponent
// and mantissa to where a float has them; subnormals are stored as 0.
inline float half_bits(ushort bits)
{
    return as_float((((int)(short)bits) << 13) & (int)0x8fffe000) * 0x1p112f;
}

// cache_lighting: one work-group per cache, the first of them `first`; partial: COEFFICIENTS
// rows of 3 x (1 + work-items) floats.
__kernel void cache_lighting(__global const uint *node_flux, LINK_PARAMS,
                             ENVIRONMENT_LIGHT_PARAM __global const int *cache_place, int first,
                             int count, float unscale, __global ushort *caches,
                             __local float *partial)
{
    const int lane = get_local_id(0), lanes = get_local_size(0);
    const int cache = first + min((int)get_group_id(0), count - 1);
    __global const int *nodes = link_node + (size_t)cache * LINKS;
    float3 sum[COEFFICIENTS];
    for (int j = 0; j < COEFFICIENTS; ++j)
        sum[j] = (float3)(0.0f);
    for (int k = lane; k < LINKS; k += lanes) {
        const float3 flux = shared_decode(node_flux[nodes[k]]);
#if PROJECTION == PROJECTION_STORED
        __global const ushort *lights = link_light + (size_t)cache * LINKS * COEFFICIENTS + k;
#pragma unroll
        for (int j = 0; j < COEFFICIENTS; ++j)
            sum[j] += flux * half_bits(lights[j * LINKS]);
#else
        __global const ushort *weights =
            (__global const ushort *)link_weight + (size_t)cache * LINKS * 2 + k;
        float y[COEFFICIENTS];
        cap_basis(link_direction[(size_t)cache * LINKS + k], half_bits(weights[0]),
                  half_bits(weights[LINKS]), y);
#pragma unroll
        for (int j = 0; j < COEFFICIENTS; ++j)
            sum[j] += flux * y[j];
#endif
    }
    // A row for each coefficient and channel, one float longer than the group, so that work-items that
    // go along neighbouring rows meet in no bank.
    const int stride = lanes + 1;
#pragma unroll
    for (int j = 0; j < COEFFICIENTS; ++j) {
        partial[3 * j * stride + lane] = sum[j].x;
        partial[(3 * j + 1) * stride + lane] = sum[j].y;
        partial[(3 * j + 2) * stride + lane] = sum[j].z;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int row = lane; row < 3 * COEFFICIENTS; row += lanes) {
        float all = 0.0f;
        for (int i = 0; i < lanes; ++i)
            all += partial[row * stride + i];
        partial[row * stride] = all;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int j = lane; j < COEFFICIENTS; j += lanes) {
        const float3 all = (float3)(partial[3 * j * stride], partial[(3 * j + 1) * stride],
                                    partial[(3 * j + 2) * stride]);
        STORE_CACHE(j, all);
    }
}
