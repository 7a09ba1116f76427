// What the camera sees as in camera.cl, PACKET pixels at a time: for processors with wide vectors.
#include "common/bvh_packet.cl"
#include "common/camera.cl"
#include "common/environment.cl"
#include "common/lights.cl"
#include "common/material.cl"
#include "common/normal_map.cl"
#include "common/pixels.cl"
#include "common/sampling.cl"
#include "common/shade.cl"
#include "parts/gbuffer.cl"

typedef struct {
    float x[PACKET] __attribute__((aligned(64)));
    float y[PACKET] __attribute__((aligned(64)));
    float z[PACKET] __attribute__((aligned(64)));
} Vectors;

inline void set_vector(Vectors *v, int i, float3 value)
{
    v->x[i] = value.x;
    v->y[i] = value.y;
    v->z[i] = value.z;
}

#define LANES(array) (*(const pfloat *)(array))

// camera: one work-item per PACKET pixels in a row of the tiled order (common/pixels.cl), whose primary
// rays and whose shadow rays to one light run as packets; else as in camera.cl.
__kernel void camera(BVH_PARAMS, SURFACE_PARAMS, LIGHT_PARAMS, ENVIRONMENT_PARAMS,
                     __global const float *camera, int width, int height, KEPT_PARAMS
                     __global float *image NORMAL_MAP_PARAM)
{
    const int first = PACKET * get_global_id(0);
    const int2 corner = tiled_pixel(first, width);
    if (corner.y >= height)
        return;
    Vectors origins, directions;
    float limits[PACKET] __attribute__((aligned(64)));
    for (int i = 0; i < PACKET; ++i) {
        const int2 pixel = corner + tile_offset(i);
        const Ray ray = primary_ray(camera, pixel, width, height);
        set_vector(&origins, i, ray.origin);
        set_vector(&directions, i, ray.direction);
        limits[i] = pixel.x < width && pixel.y < height ? INFINITY : 0.0f;
    }
    const HitPacket found = bvh_closest_packet(
        BVH_ARGS, LANES(origins.x), LANES(origins.y), LANES(origins.z), LANES(directions.x),
        LANES(directions.y), LANES(directions.z), LANES(limits));
    float us[PACKET] __attribute__((aligned(64))), vs[PACKET] __attribute__((aligned(64)));
    int triangles_hit[PACKET] __attribute__((aligned(64)));
    *(pfloat *)us = found.u;
    *(pfloat *)vs = found.v;
    *(pint *)triangles_hit = found.triangle;

    float3 radiance[PACKET], reflectance[PACKET], seen[PACKET], start[PACKET];
    float3 normal[PACKET], geometric[PACKET];
    bool lit[PACKET];
    bool any_lit = false;
    for (int i = 0; i < PACKET; ++i) {
        lit[i] = false;
        radiance[i] = (float3)(0.0f);
        if (!(limits[i] > 0.0f))
            continue;
        const float3 direction = (float3)(directions.x[i], directions.y[i], directions.z[i]);
        const Hit hit = {0.0f, us[i], vs[i], triangles_hit[i]};
        if (hit.triangle < 0) {
            radiance[i] = environment_radiance(ENVIRONMENT_ARGS, direction);
            KEEP_NOTHING(first + i, row_place(corner + tile_offset(i), width));
            continue;
        }
        Surface s = surface_at(SURFACE_ARGS, hit);
#if NORMAL_MAPS
        s.normal = mapped_normal(normal_maps, hit.triangle, hit.u, hit.v, s.normal,
                                 s.geometric_normal);
#endif
        if (dot(s.geometric_normal, direction) >= 0.0f) {
            KEEP_NOTHING(first + i, row_place(corner + tile_offset(i), width));
            continue;
        }
        KEEP(first + i, row_place(corner + tile_offset(i), width), hit, s);
        lit[i] = true;
        any_lit = true;
        radiance[i] = s.emission;
        reflectance[i] = diffuse_reflectance(s.albedo);
        seen[i] = back_along_ray(s.position, direction);
        start[i] = offset_from_surface(seen[i], s.geometric_normal);
        normal[i] = s.normal;
        geometric[i] = s.geometric_normal;
    }
    for (int l = 0; any_lit && l < light_count; ++l) {
        float3 gains[PACKET];
        float3 some_start = (float3)(0.0f), some_towards = (float3)(0.0f);
        bool any = false;
        for (int i = 0; i < PACKET; ++i) {
            limits[i] = 0.0f;
            if (!lit[i])
                continue;
            const LightSample s = light_at(lights + l * LIGHT_FLOATS, seen[i]);
            gains[i] = unshadowed_irradiance(s, normal[i], geometric[i]);
            if (gains[i].x + gains[i].y + gains[i].z > 0.0f) {
                limits[i] = s.distance * SHADOW_RAY_SHARE;
                set_vector(&origins, i, start[i]);
                set_vector(&directions, i, s.towards);
                some_start = start[i];
                some_towards = s.towards;
                any = true;
            }
        }
        if (!any)
            continue;
        // A ray that is left out takes another's place: the packet's bounds hold no more for it.
        for (int i = 0; i < PACKET; ++i) {
            if (!(limits[i] > 0.0f)) {
                set_vector(&origins, i, some_start);
                set_vector(&directions, i, some_towards);
            }
        }
        int blocked[PACKET] __attribute__((aligned(64)));
        *(pint *)blocked = bvh_occluded_packet(
            BVH_ARGS, LANES(origins.x), LANES(origins.y), LANES(origins.z), LANES(directions.x),
            LANES(directions.y), LANES(directions.z), LANES(limits));
        for (int i = 0; i < PACKET; ++i) {
            if (limits[i] > 0.0f && !blocked[i])
                radiance[i] = with_diffuse(radiance[i], reflectance[i], gains[i]);
        }
    }
    for (int i = 0; i < PACKET; ++i) {
        const int2 pixel = corner + tile_offset(i);
        if (pixel.x < width && pixel.y < height)
            store3(image, (size_t)pixel.y * width + pixel.x, radiance[i]);
    }
}
