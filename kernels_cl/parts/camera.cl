// What the camera sees without any indirect light: primary rays, and direct light with shadow rays.
#include "common/bvh.cl"
#include "common/camera.cl"
#include "common/environment.cl"
#include "common/lights.cl"
#include "common/material.cl"
#include "common/normal_map.cl"
#include "common/pixels.cl"
#include "common/sampling.cl"
#include "common/shade.cl"
#include "parts/gbuffer.cl"

// camera: one work-item per pixel, in tiled order (common/pixels.cl).
//   radiance = emission + albedo / pi direct irradiance, the environment on a miss, black on a
//   surface's back. Bennett 2019, section 5.4 (there by rasterisation).
// image: (height, width, 3) W/m2/sr. What else is kept: parts/gbuffer.cl. NORMAL_MAPS: shaded with the
// normals of common/normal_map.cl.
__kernel void camera(BVH_PARAMS, SURFACE_PARAMS, LIGHT_PARAMS, ENVIRONMENT_PARAMS,
                     __global const float *camera, int width, int height, KEPT_PARAMS
                     __global float *image NORMAL_MAP_PARAM)
{
    const int item = get_global_id(0);
    const int2 pixel = tiled_pixel(item, width);
    if (pixel.x >= width || pixel.y >= height)
        return;
    const int at = row_place(pixel, width);
    const Ray ray = primary_ray(camera, pixel, width, height);
    const Hit hit = bvh_closest(BVH_ARGS, ray.origin, ray.direction, INFINITY);
    float3 radiance = (float3)(0.0f);
    if (hit.triangle < 0) {
        radiance = environment_radiance(ENVIRONMENT_ARGS, ray.direction);
        KEEP_NOTHING(item, at);
    } else {
        Surface s = surface_at(SURFACE_ARGS, hit);
#if NORMAL_MAPS
        s.normal = mapped_normal(normal_maps, hit.triangle, hit.u, hit.v, s.normal,
                                 s.geometric_normal);
#endif
        if (dot(s.geometric_normal, ray.direction) < 0.0f) {
            KEEP(item, at, hit, s);
            const float3 irradiance =
                direct_irradiance(BVH_ARGS, LIGHT_ARGS, back_along_ray(s.position, ray.direction),
                                  s.normal, s.geometric_normal);
            radiance = with_reflected(s.emission, s.albedo, irradiance);
        } else {
            KEEP_NOTHING(item, at);
        }
    }
    store3(image, at, radiance);
}
