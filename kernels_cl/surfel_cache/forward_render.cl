// The caches' light where it is wanted: at the camera's pixels and at the light map's receivers.
// Macros: those of caches.cl; GBUFFER, PIXELS (parts/apply.cl).
#include "common/bvh.cl"
#include "common/camera.cl"
#include "common/material.cl"
#include "common/pixels.cl"
#include "common/shade.cl"
#include "parts/gbuffer.cl"
#include "surfel_cache/caches.cl"

// cache_uvs  (t, 6) the triangles' corners in texels of the caches' map; all negative where a
//            triangle has no place in it, or moves

inline float2 map_place(__global const float *cache_uvs, Hit hit)
{
    __global const float *corner = cache_uvs + 6 * (size_t)hit.triangle;
    if (corner[0] < 0.0f)
        return (float2)(-1.0f);
    return (1.0f - hit.u - hit.v) * vload2(0, corner) + hit.u * vload2(1, corner) +
           hit.v * vload2(2, corner);
}

// forward_render: one work-item per PIXELS pixels in a row of the tiled order (common/pixels.cl).
//   radiance = direct light + albedo / pi irradiance + gloss (light under a lobe cos^exponent about
//   the mirrored direction, of volume one)
// Jendersie et al. 2016, section 3.2. No lobe with an exponent of 0.
// image: (height, width, 3) W/m2/sr; parts/camera.cl has left the direct light in it, which counts with
// SHOW_DIRECT alone. show: sum of SHOW_DIRECT and SHOW_INDIRECT.
__kernel void forward_render(SHAPE_PARAMS, CACHE_PARAMS, __global const float *cache_uvs,
                             float exponent, float gloss, __global const float *camera, int width,
                             int height, __global const float *gbuffer, int show,
                             __global float *image)
{
    const int first = PIXELS * get_global_id(0);
    const int2 corner = tiled_pixel(first, width);
    const float4 glossy_bands = lobe_bands(exponent);
    for (int i = 0; i < PIXELS; ++i) {
        const int2 pixel = corner + tile_offset(i);
        if (pixel.x >= width || pixel.y >= height)
            continue;
        const Kept kept = kept_hit(gbuffer, first + i);
        const bool applies = kept.hit.triangle >= 0 && (show & SHOW_INDIRECT);
        if (!applies && (show & SHOW_DIRECT))
            continue;
        const size_t at = row_place(pixel, width);
        float3 radiance = (show & SHOW_DIRECT) ? load3(image, at) : (float3)(0.0f);
        if (applies) {
            const Surface s = surface_shape(SHAPE_ARGS, kept.hit);
            const float2 place = map_place(cache_uvs, kept.hit);
            const Lobe diffuse = lobe_towards(s.normal, DIFFUSE_BANDS);
            const float3 irradiance = PI_F * gathered_light(CACHE_ARGS, place, s.position, &diffuse);
            radiance = with_reflected(radiance, kept.albedo, irradiance);
            if (exponent > 0.0f) {
                const float3 seen = primary_ray(camera, pixel, width, height).direction;
                const float3 mirrored = seen - 2.0f * dot(seen, s.normal) * s.normal;
                const Lobe glossy = lobe_towards(mirrored, glossy_bands);
                radiance += gloss * gathered_light(CACHE_ARGS, place, s.position, &glossy);
            }
        }
        store3(image, at, radiance);
    }
}

// receiver_irradiance: one work-item per receiver; irradiance: (count, 3) W/m2.
// place: (count, 2) in texels of the caches' map, negative where it has none.
__kernel void receiver_irradiance(CACHE_PARAMS, __global const float *place,
                                  __global const float *position, __global const float *normal,
                                  int count, __global float *irradiance)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const Lobe diffuse = lobe_towards(load3(normal, i), DIFFUSE_BANDS);
    store3(irradiance, i,
           PI_F * gathered_light(CACHE_ARGS, vload2(i, place), load3(position, i), &diffuse));
}
