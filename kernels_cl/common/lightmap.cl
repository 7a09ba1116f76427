// Lightmaps: for each texel, row by row, the float4 of each of the signal's COMPONENTS, of which the
// first is irradiance; w is 1 where the texel is a receiver and 0 elsewhere.
#ifndef GIBENCH_LIGHTMAP
#define GIBENCH_LIGHTMAP

#include "common/vec.cl"
#include "common/bvh.cl"

// lightmap_uvs  (t, 6) the triangles' corners in texels, (0.5, 0.5) the centre of texel 0; all
//               negative where a triangle has no place in the atlas
// irradiance    the lightmap that is looked up
#define LIGHTMAP_PARAMS                                                        \
    __global const float *lightmap_uvs, __global const float4 *irradiance_map, \
        int lightmap_width, int lightmap_height
#define LIGHTMAP_ARGS lightmap_uvs, irradiance_map, lightmap_width, lightmap_height

// A component, bilinear at texel centres, clamped at the border.
inline float3 lightmap_bilinear(__global const float4 *map, int width, int height, float2 at,
                                int component)
{
    const float x = at.x - 0.5f, y = at.y - 0.5f;
    const float x_floor = floor(x), y_floor = floor(y);
    const int x0 = COMPONENTS * clamp((int)x_floor, 0, width - 1);
    const int x1 = COMPONENTS * clamp((int)x_floor + 1, 0, width - 1);
    const int y0 = clamp((int)y_floor, 0, height - 1), y1 = clamp((int)y_floor + 1, 0, height - 1);
    __global const float4 *top = map + (size_t)y0 * width * COMPONENTS + component;
    __global const float4 *bottom = map + (size_t)y1 * width * COMPONENTS + component;
    return mix(mix(top[x0].xyz, top[x1].xyz, x - x_floor),
               mix(bottom[x0].xyz, bottom[x1].xyz, x - x_floor), y - y_floor);
}

// Whether a hit's triangle has a place in the atlas; then where in it, in texels.
inline bool lightmap_place(__global const float *lightmap_uvs, Hit hit, float2 *at)
{
    __global const float *corner = lightmap_uvs + 6 * (size_t)hit.triangle;
    if (corner[0] < 0.0f)
        return false;
    *at = (1.0f - hit.u - hit.v) * vload2(0, corner) + hit.u * vload2(1, corner) +
          hit.v * vload2(2, corner);
    return true;
}

// The signal at a hit, all its components; black on a triangle without a place in the atlas.
inline void lightmap_signal(LIGHTMAP_PARAMS, Hit hit, float3 *signal)
{
    float2 at;
    const bool placed = lightmap_place(lightmap_uvs, hit, &at);
    for (int c = 0; c < COMPONENTS; ++c)
        signal[c] = placed ? lightmap_bilinear(irradiance_map, lightmap_width, lightmap_height, at, c)
                           : (float3)(0.0f);
}

// Irradiance at a hit: the signal's first component.
inline float3 lightmap_irradiance(LIGHTMAP_PARAMS, Hit hit)
{
    float2 at;
    if (!lightmap_place(lightmap_uvs, hit, &at))
        return (float3)(0.0f);
    return lightmap_bilinear(irradiance_map, lightmap_width, lightmap_height, at, 0);
}

#endif
