// The caches' light from their links (Jendersie et al. 2016, equation 4 and section 4.6): a thread for
// each cache goes over its links. Macros: those of links.cl; VEC 1.
#include "surfel_cache/caps.cl"
#include "surfel_cache/links.cl"

// cache_lighting: one work-item per cache, the first of them `first`.
__kernel void cache_lighting(__global const uint *node_flux, LINK_PARAMS,
                             ENVIRONMENT_LIGHT_PARAM __global const int *cache_place, int first,
                             int count, float unscale, __global ushort *caches)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int cache = first + i;
    float3 sum[COEFFICIENTS];
    for (int j = 0; j < COEFFICIENTS; ++j)
        sum[j] = (float3)(0.0f);
    for (int k = 0; k < LINKS; ++k) {
        const size_t link = (size_t)cache * LINKS + k;
        const float3 flux = shared_decode(node_flux[link_node[link]]);
#if PROJECTION == PROJECTION_STORED
        for (int j = 0; j < COEFFICIENTS; ++j)
            sum[j] += flux * vload_half(link * COEFFICIENTS + j, (__global const half *)link_light);
#else
        const float2 w = vload_half2(link, (__global const half *)link_weight);
        float y[COEFFICIENTS];
        cap_basis(link_direction[link], w.x, w.y, y);
        for (int j = 0; j < COEFFICIENTS; ++j)
            sum[j] += flux * y[j];
#endif
    }
    for (int j = 0; j < COEFFICIENTS; ++j)
        STORE_CACHE(j, sum[j]);
}
