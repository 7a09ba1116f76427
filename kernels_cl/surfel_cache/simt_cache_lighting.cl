// The caches' light from their links where work-items run in lockstep: a group for each cache, whose
// work-items are its links, so that neighbours read neighbouring halves. Each keeps the sums of its
// links; the group adds them up in local memory, in halves. A work-item for each cache would need no
// sum, but caches are a few thousand, which fill no GPU. Links lie as for tuned_cache_lighting.cl.
// Macros: those of links.cl; TEAM (the work-group's size).
#include "surfel_cache/caps.cl"
#include "surfel_cache/links.cl"

// A half by integer operations: some compilers call a function for vload_half. Sign to bit 31, exponent
// and mantissa to where a float has them; subnormals are stored as 0.
inline float half_bits(ushort bits)
{
    return as_float((((int)(short)bits) << 13) & (int)0x8fffe000) * 0x1p112f;
}

// cache_lighting: one work-group per cache, the first of them `first`; partial: 3 * COEFFICIENTS rows
// of a float per work-item.
__kernel void cache_lighting(__global const uint *node_flux, LINK_PARAMS,
                             ENVIRONMENT_LIGHT_PARAM __global const int *cache_place, int first,
                             int count, float unscale, __global ushort *caches,
                             __local float *partial)
{
    // Not ints: see srp/simt_projection.cl.
    const size_t lane = get_local_id(0), lanes = TEAM;
    const int cache = first + min((int)get_group_id(0), count - 1);
    __global const int *nodes = link_node + (size_t)cache * LINKS;
    // Not float3: a compiler that makes vectors of work-items turns such an array over at each access.
    float red[COEFFICIENTS], green[COEFFICIENTS], blue[COEFFICIENTS];
#pragma unroll
    for (int j = 0; j < COEFFICIENTS; ++j)
        red[j] = green[j] = blue[j] = 0.0f;
    for (size_t turn = 0; turn < LINKS; turn += lanes) {
        const size_t k = turn + lane;
#if LINKS % TEAM
        if (k >= LINKS)
            continue;
#endif
        const float3 flux = shared_decode(node_flux[nodes[k]]);
#if PROJECTION == PROJECTION_STORED
        __global const ushort *lights = link_light + (size_t)cache * LINKS * COEFFICIENTS;
#pragma unroll
        for (int j = 0; j < COEFFICIENTS; ++j) {
            const float light = half_bits(lights[j * LINKS + k]);
            red[j] += flux.x * light;
            green[j] += flux.y * light;
            blue[j] += flux.z * light;
        }
#else
        __global const ushort *weights =
            (__global const ushort *)link_weight + (size_t)cache * LINKS * 2;
        float y[COEFFICIENTS];
        cap_basis(link_direction[(size_t)cache * LINKS + k], half_bits(weights[k]),
                  half_bits(weights[LINKS + k]), y);
#pragma unroll
        for (int j = 0; j < COEFFICIENTS; ++j) {
            red[j] += flux.x * y[j];
            green[j] += flux.y * y[j];
            blue[j] += flux.z * y[j];
        }
#endif
    }
#pragma unroll
    for (int j = 0; j < COEFFICIENTS; ++j) {
        partial[3 * j * lanes + lane] = red[j];
        partial[(3 * j + 1) * lanes + lane] = green[j];
        partial[(3 * j + 2) * lanes + lane] = blue[j];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (size_t left = lanes; left > 1; left = (left + 1) / 2) {
        const size_t upper = (left + 1) / 2;
        if (lane + upper < left) {
#pragma unroll
            for (int row = 0; row < 3 * COEFFICIENTS; ++row)
                partial[row * lanes + lane] += partial[row * lanes + upper + lane];
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    for (size_t j = lane; j < COEFFICIENTS; j += lanes) {
        const float3 all = (float3)(partial[3 * j * lanes], partial[(3 * j + 1) * lanes],
                                    partial[(3 * j + 2) * lanes]);
        STORE_CACHE(j, all);
    }
}
