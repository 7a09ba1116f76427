// What the camera sees, and the surfels' light on it (Ekberg 2022, sections 3.1.4 and 4.4).
#include "common/bvh.cl"
#include "common/camera.cl"
#include "common/environment.cl"
#include "common/lights.cl"
#include "common/material.cl"
#include "common/pixels.cl"
#include "common/sampling.cl"
#include "common/shade.cl"
#include "gibs/gather.cl"

// Application marks the surfels of every pixel once in so many frames, another pixel of each 4 x 4
// block every frame: a visible surfel covers far more pixels than that.
#define MARKED_SIDE 4

// gbuffer: one work-item per pixel, in tiled order (common/pixels.cl).
// g_position: position, m, and as int the object's number from 1; 0 where there is no surface's front.
// g_normal: unit shading normal. g_albedo: albedo. direct: (pixels, 3) emission and reflected direct
// light, or the environment. object_of: (triangles,) object numbers from 0.
__kernel void gbuffer(BVH_PARAMS, SURFACE_PARAMS, LIGHT_PARAMS, ENVIRONMENT_PARAMS,
                      __global const float *camera, int width, int height,
                      __global const int *object_of, __global float4 *g_position,
                      __global float4 *g_normal, __global float4 *g_albedo, __global float *direct)
{
    const int2 pixel = tiled_pixel(get_global_id(0), width);
    if (pixel.x >= width || pixel.y >= height)
        return;
    const int at = pixel.y * width + pixel.x;
    const Ray ray = primary_ray(camera, pixel, width, height);
    const Hit hit = bvh_closest(BVH_ARGS, ray.origin, ray.direction, INFINITY);
    float3 radiance = (float3)(0.0f), position = radiance, normal = radiance, albedo = radiance;
    int object = 0;
    if (hit.triangle < 0) {
        radiance = environment_radiance(ENVIRONMENT_ARGS, ray.direction);
    } else {
        const Surface s = surface_at(SURFACE_ARGS, hit);
        if (dot(s.geometric_normal, ray.direction) < 0.0f) {
            object = object_of[hit.triangle] + 1;
            position = s.position;
            normal = s.normal;
            albedo = s.albedo;
            const float3 irradiance =
                direct_irradiance(BVH_ARGS, LIGHT_ARGS, back_along_ray(s.position, ray.direction),
                                  s.normal, s.geometric_normal);
            radiance = with_reflected(s.emission, s.albedo, irradiance);
        }
    }
    g_position[at] = (float4)(position, as_float(object));
    g_normal[at] = (float4)(normal, 0.0f);
    g_albedo[at] = (float4)(albedo, 0.0f);
    store3(direct, at, radiance);
}

// application: one work-item per pixel, in tiled order.
// indirect: (pixels,) indirect irradiance, W/m2, and coverage. image: (pixels, 3) direct light and
// what the surface makes of the indirect, W/m2/sr. seen: (CAPACITY,) the frame each surfel was last
// seen in.
__kernel void application(__global const uint *frame, GATHER_PARAMS, int width, int height,
                          __global const float4 *g_position, __global const float4 *g_normal,
                          __global const float4 *g_albedo, __global const float *direct,
                          __global uint *seen, __global float4 *indirect, __global float *image)
{
    const int2 pixel = tiled_pixel(get_global_id(0), width);
    if (pixel.x >= width || pixel.y >= height)
        return;
    const int at = pixel.y * width + pixel.x;
    const float4 position = g_position[at];
    float3 radiance = load3(direct, at);
    float4 result = (float4)(0.0f);
    if (as_int(position.w) != 0) {
        const uint number = frame[FRAME_NUMBER];
        const bool marks = pixel.x % MARKED_SIDE == number % MARKED_SIDE &&
                           pixel.y % MARKED_SIDE == number / MARKED_SIDE % MARKED_SIDE;
        const Gathered g = gather(GATHER_ARGS, position.xyz, g_normal[at].xyz,
                                  marks ? seen : (__global uint *)0, number);
        result = (float4)(g.irradiance, g.coverage);
        radiance = with_reflected(radiance, g_albedo[at].xyz, g.irradiance);
    }
    indirect[at] = result;
    store3(image, at, radiance);
}

// gather_points: one work-item per point; the indirect irradiance and the coverage at (count,)
// points, for receivers and tests.
__kernel void gather_points(GATHER_PARAMS, __global const float *position,
                            __global const float *normal, int count, __global float4 *indirect)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const Gathered g =
        gather(GATHER_ARGS, load3(position, i), load3(normal, i), (__global uint *)0, 0);
    indirect[i] = (float4)(g.irradiance, g.coverage);
}
