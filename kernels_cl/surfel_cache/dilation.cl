// Dilation of the caches' map over the eight neighbours (Jendersie et al. 2016, sections 3.2 and 4.4), so
// that interpolation at a chart's border meets nothing empty. Macros: BANDS.
// In place and free of races: of lit caches everything is only read, of dilated ones the first
// coefficient's mark is only read and the rest only written.

#include "surfel_cache/coefficients.cl"

inline float cache_mark(__global const half *map, size_t texel)
{
    return vload_half(texel * COEFFICIENTS * 4 + 3, map);
}

inline void dilate_cache(__global ushort *cache_map, int width, int height, int x, int y)
{
    __global half *map = (__global half *)cache_map;
    for (int j = 0; j < COEFFICIENTS; ++j) {
        float3 sum = (float3)(0.0f);
        float count = 0.0f;
        for (int v = max(y - 1, 0); v <= min(y + 1, height - 1); ++v)
            for (int u = max(x - 1, 0); u <= min(x + 1, width - 1); ++u) {
                const size_t texel = (size_t)v * width + u;
                if (cache_mark(map, texel) == CACHE_LIT) {
                    sum += vload_half4(texel * COEFFICIENTS + j, map).xyz;
                    count += 1.0f;
                }
            }
        sum /= fmax(count, 1.0f);
        const size_t at = 4 * (((size_t)y * width + x) * COEFFICIENTS + j);
        vstore_half(sum.x, at, map);
        vstore_half(sum.y, at + 1, map);
        vstore_half(sum.z, at + 2, map);
    }
}

// dilation: one work-item per texel of the map, as published.
__kernel void dilation(__global ushort *cache_map, int width, int height)
{
    const int i = get_global_id(0);
    if (i >= width * height)
        return;
    const float mark = cache_mark((__global const half *)cache_map, i);
    if (mark > 0.0f && mark < CACHE_LIT)
        dilate_cache(cache_map, width, height, i % width, i / width);
}

// dilation_border: one work-item per texel that is filled, from a list made once.
__kernel void dilation_border(__global ushort *cache_map, int width, int height,
                              __global const int *cache_border, int count)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    dilate_cache(cache_map, width, height, cache_border[i] % width, cache_border[i] / width);
}
