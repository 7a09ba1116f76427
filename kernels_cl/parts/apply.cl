// A technique's indirect light on what the camera sees: the lookup at the pixel, which is its own, and
// the shading, which is not.
//
// A program defines, and then includes this file:
//   LOOKUP_PARAMS, LOOKUP_ARGS    what its lookup reads
//   float3 looked_up(LOOKUP_PARAMS, Hit hit, float3 direction)
//       irradiance, W/m2, at a hit of a surface's front seen along a unit direction
// or with REFLECTED=1, where it does not reflect alike to all sides:
//   float3 reflected(LOOKUP_PARAMS, Hit hit, float3 direction, float3 albedo)
//       radiance, W/m2/sr, that it sends back along the direction
// Macros: GBUFFER, which is GBUFFER_HIT (parts/gbuffer.cl); PIXELS of a work-item, a power of two.
#include "common/camera.cl"
#include "common/pixels.cl"
#include "common/shade.cl"
#include "parts/gbuffer.cl"

// application: one work-item per PIXELS pixels in a row of the tiled order (common/pixels.cl).
//   radiance = direct light + albedo / pi irradiance looked up
// image: (height, width, 3) W/m2/sr; parts/camera.cl has left the direct light in it, which counts with
// SHOW_DIRECT alone. show: sum of SHOW_DIRECT and SHOW_INDIRECT.
__kernel void application(LOOKUP_PARAMS, __global const float *camera, int width, int height,
                          __global const float *gbuffer, int show, __global float *image)
{
    const int first = PIXELS * get_global_id(0);
    const int2 corner = tiled_pixel(first, width);
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
            const float3 direction = primary_ray(camera, pixel, width, height).direction;
#if REFLECTED
            radiance += reflected(LOOKUP_ARGS, kept.hit, direction, kept.albedo);
#else
            const float3 irradiance = looked_up(LOOKUP_ARGS, kept.hit, direction);
            radiance = with_reflected(radiance, kept.albedo, irradiance);
#endif
        }
        store3(image, at, radiance);
    }
}
