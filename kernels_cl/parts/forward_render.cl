// The camera image: primary rays, direct light with shadow rays, indirect light from a lightmap.
#include "common/bvh.cl"
#include "common/camera.cl"
#include "common/environment.cl"
#include "common/lightmap.cl"
#include "common/lights.cl"
#include "common/material.cl"
#include "common/pixels.cl"
#include "common/sampling.cl"
#include "common/shade.cl"

// forward_render: one work-item per pixel, in tiled order (common/pixels.cl).
//   radiance = emission + albedo / pi (direct + indirect irradiance), the environment on a miss,
//   black on a surface's back. Bennett 2019, section 5.4 (there by rasterisation).
// image: (height, width, 3) W/m2/sr. show: sum of SHOW_DIRECT and SHOW_INDIRECT. Built with INDIRECT=0 it takes and reads no lightmap.
__kernel void forward_render(BVH_PARAMS, SURFACE_PARAMS, LIGHT_PARAMS, ENVIRONMENT_PARAMS,
                             __global const float *camera, int width, int height, int show,
#if INDIRECT
                             LIGHTMAP_PARAMS,
#endif
                             __global float *image)
{
    const int2 pixel = tiled_pixel(get_global_id(0), width);
    if (pixel.x >= width || pixel.y >= height)
        return;
    const Ray ray = primary_ray(camera, pixel, width, height);
    const Hit hit = bvh_closest(BVH_ARGS, ray.origin, ray.direction, INFINITY);
    float3 radiance = (float3)(0.0f);
    if (hit.triangle < 0) {
        if (show & SHOW_DIRECT)
            radiance = environment_radiance(ENVIRONMENT_ARGS, ray.direction);
    } else {
        const Surface s = surface_at(SURFACE_ARGS, hit);
        if (dot(s.geometric_normal, ray.direction) < 0.0f) {
            float3 irradiance = (float3)(0.0f);
            if (show & SHOW_DIRECT) {
                radiance = s.emission;
                const float3 seen = back_along_ray(s.position, ray.direction);
                irradiance =
                    direct_irradiance(BVH_ARGS, LIGHT_ARGS, seen, s.normal, s.geometric_normal);
            }
#if INDIRECT
            if (show & SHOW_INDIRECT)
                irradiance += lightmap_irradiance(LIGHTMAP_ARGS, hit);
#endif
            radiance = with_reflected(radiance, s.albedo, irradiance);
        }
    }
    store3(image, (size_t)pixel.y * width + pixel.x, radiance);
}
