// The caches' light from their links (Jendersie et al. 2016, equation 4 and section 4.6): a thread for
// each cache goes over its links. Macros: those of links.cl; VEC 1.
#include "common/octahedral.cl"
#include "surfel_cache/links.cl"

inline float snorm16(uint bits)
{
    return fmax((float)(short)(bits & 0xffffu) / 32767.0f, -1.0f);
}

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
        // A cap of the solid angle about the direction: the factor of each band over the first's.
        const uint packed = link_direction[link];
        const float3 d = octahedral_decode((float2)(snorm16(packed), snorm16(packed >> 16)));
        const float2 w = vload_half2(link, (__global const half *)link_weight);
        const float c = 1.0f - w.y / TWO_PI_F;
        const float one = 0.5f * (1.0f + c);
        const float bands[4] = {1.0f, one, one * c, one * (5.0f * c * c - 1.0f) * 0.25f};
        float y[COEFFICIENTS];
        for (int j = 0; j < COEFFICIENTS; ++j)
            y[j] = 0.0f;
        sh_accumulate(d.x, d.y, d.z, w.x, y);
        for (int l = 0; l < BANDS; ++l)
            for (int j = l * l; j < (l + 1) * (l + 1); ++j)
                sum[j] += flux * (bands[l] * y[j]);
#endif
    }
    for (int j = 0; j < COEFFICIENTS; ++j)
        STORE_CACHE(j, sum[j]);
}
