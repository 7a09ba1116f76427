// Wavefront path tracing on the host, rays by Embree in between (Laine, Karras and Aila 2013,
// "Megakernels Considered Harmful", section 4: one kernel per stage over dense queues).
//
// Macros: GROUP, work-items per group; every launch is rounded up to whole groups. VEC: see
// reference/draws.cl. CUTOUTS: see common/cutout.cl. GLOW: see reference/glow.cl.
// NORMAL_MAPS: see common/normal_map.cl; the first surface of a path, a receiver's or what the camera
// sees, is shaded with its mapped normal, those after it with the interpolated one.
//
// A wave is a run of consecutive paths; path p of it belongs to owner `first + p / samples` (a
// receiver or a pixel) and is sample p % samples of that owner. Per path: throughput and what it
// has collected, (paths, 3) each, in units of the integral of radiance times cosine over pi.
// A vertex is a surface point that a path has reached. Vertices are dense, in no fixed order; the
// ray that leaves vertex i is ray i. Per vertex: origin (off the surface), direction, shading and
// geometric normal (n, 3), path (n), and the density of its direction (n), negative for a ray that
// must not be followed.
#ifndef GIBENCH_REFERENCE_PATH
#define GIBENCH_REFERENCE_PATH
#include "reference/draws.cl"
#include "reference/surface.cl"
#include "reference/lights.cl"
#include "common/normal_map.cl"

// At most this share of the paths that may end by chance goes on.
#define ROULETTE_SURVIVAL 0.95f

// Vertex 0 of every path: a uniformly distributed point on the receiver's covered surface.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void start_at_receivers(
    uint count, uint first, uint samples,
    __global const float *triangles,
    __global const int *fragment_start,       // (receivers + 1)
    __global const float *fragment_table,     // (fragments) cumulative share of the receiver's area
    __global const float *fragment_corners,   // (fragments, 3, 3)
    __global const int *fragment_triangle,    // (fragments)
    uint stride, __global const float *drawn,
    __global float *throughput, __global float *collected,
    __global float *origin, __global float *shading, __global float *geometric,
    __global int *path NORMAL_MAP_PARAM)
{
    const uint p = get_global_id(0);
    if (p >= count)
        return;
    const uint owner = first + p / samples;
    const int begin = fragment_start[owner], end = fragment_start[owner + 1];
    const float chosen = drawn[(size_t)stride * DRAWN_FRAGMENT + p];
    const int f = begin + find_interval(fragment_table + begin, end - begin, chosen);
    const float2 at = drawn_pair(drawn, stride, DRAWN_START, p);
    const float r = sqrt(at.x);
    const float3 a = load3(fragment_corners, 3 * f);
    const float3 b = load3(fragment_corners, 3 * f + 1);
    const float3 c = load3(fragment_corners, 3 * f + 2);
    const float3 point = a + r * (1.0f - at.y) * (b - a) + r * at.y * (c - a);
    // The fragment lies on a triangle: barycentric coordinates there, for the shading normal.
    __global const float *t = triangles + (size_t)fragment_triangle[f] * TRIANGLE_FLOATS;
    const float3 e1 = load3(t, 1) - load3(t, 0), e2 = load3(t, 2) - load3(t, 0);
    const float3 q = point - load3(t, 0), n = cross(e1, e2);
    const float u = clamp(dot(cross(q, e2), n) / dot(n, n), 0.0f, 1.0f);
    const float v = clamp(dot(cross(e1, q), n) / dot(n, n), 0.0f, 1.0f - u);
    Surface s = surface_at(triangles, fragment_triangle[f], u, v);
#if NORMAL_MAPS
    s.shading = mapped_normal(normal_maps, fragment_triangle[f], u, v, s.shading, s.geometric);
#endif
    store3(throughput, p, (float3)(1.0f));
    store3(collected, p, (float3)(0.0f));
    store3(origin, p, leave_surface(s.point, s.geometric));
    store3(shading, p, s.shading);
    store3(geometric, p, s.geometric);
    path[p] = p;
}

// Camera rays through uniformly distributed points of each pixel; row 0 is the top.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void start_at_camera(
    uint count, uint first, uint samples,
    uint width, uint height,
    __global const float *camera,             // (4, 3) position, forward, right, up; the last two
                                              // reach the image's edges from its centre
    uint stride, __global const float *drawn,
    __global float *throughput, __global float *collected,
    __global float *origin, __global float *direction, __global int *path,
    __global float *density)
{
    const uint p = get_global_id(0);
    if (p >= count)
        return;
    const uint owner = first + p / samples;
    const float2 in_pixel = drawn_pair(drawn, stride, DRAWN_START, p);
    const float x = 2.0f * ((owner % width) + in_pixel.x) / width - 1.0f;
    const float y = 1.0f - 2.0f * ((owner / width) + in_pixel.y) / height;
    store3(throughput, p, (float3)(1.0f));
    store3(collected, p, (float3)(0.0f));
    store3(origin, p, load3(camera, 0));
    store3(direction, p, unit(load3(camera, 1) + x * load3(camera, 2) + y * load3(camera, 3)));
    path[p] = p;
    density[p] = 1.0f;
}

// One connection of one vertex per work-item: work-item i joins vertex i / slots to light
// `first_light + i % slots`, where lights are the delta lights, then the emitters as one, then the
// environment. Connections that can carry light become dense shadow rays; `ray_of` (vertices,
// slots) says which ray each connection has, or -1.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void connect(
    uint count, uint slots, uint first_light, uint delta_lights,
    __global const float *triangles, __global const float *materials,
    __global const float *lights,
    uint emitter_count, __global const int *emitters, __global const float *emitter_table,
    int width, int height, __global const float *environment,
    __global const float *environment_density_, __global const float *environment_rows,
    __global const float *environment_columns, __global const float *environment_edges,
    uint stride, __global const float *drawn, __global const float *throughput,
    __global const float *origin, __global const float *shading, __global const float *geometric,
    __global const int *path,
    __global int *ray_of, __global float *weight,
    __global float *ray_origin, __global float *ray_direction, __global float *ray_limit,
    volatile __global int *rays CUTOUT_PARAM GLOW_PARAM PIECE_PARAM)
{
    __local int in_group, group_base;
    const uint i = get_global_id(0);
    if (get_local_id(0) == 0)
        in_group = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    int slot = -1;
    float3 point = (float3)(0.0f);
    Connection c;
    c.direction = (float3)(0.0f);
    c.distance = 0.0f;
    if (i < count * slots) {
        const uint v = i / slots, light = first_light + i % slots;
        const uint p = path[v];
        const float3 n = load3(shading, v);
        point = load3(origin, v);
        if (light < delta_lights)
            c = connect_delta(lights + light * LIGHT_FLOATS, point, n);
        else if (light == delta_lights && emitter_count)
            c = connect_emitter(triangles, materials, emitters, emitter_table, (int)emitter_count,
                                drawn_pair(drawn, stride, DRAWN_EMITTER, v), point, n
                                CUTOUT_ARG GLOW_ARG PIECE_ARG);
        else
            c = connect_environment(environment, environment_density_, environment_rows,
                                    environment_columns, environment_edges, width, height,
                                    drawn_pair(drawn, stride, DRAWN_ENVIRONMENT, v), n);
        const float3 value = c.weight * load3(throughput, p);
        if (value.x + value.y + value.z > 0.0f && dot(c.direction, load3(geometric, v)) > 0.0f) {
            slot = atomic_inc(&in_group);
            store3(weight, i, value);
        }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (get_local_id(0) == 0)
        group_base = atomic_add(rays, in_group);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (i < count * slots) {
        const int ray = slot < 0 ? -1 : group_base + slot;
        ray_of[i] = ray;
        if (ray >= 0) {
            store3(ray_origin, ray, point);
            store3(ray_direction, ray, c.direction);
            // A point light's own surroundings do not shade it; an emitter's point already lies
            // off its surface.
            ray_limit[ray] = c.distance * 0.99999f;
        }
    }
}

// Adds the connections of vertex i that nothing blocks to its path.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void resolve(
    uint count, uint slots, __global const int *path, __global const int *ray_of,
    __global const float *weight, __global const uchar *blocked, __global float *collected)
{
    const uint v = get_global_id(0);
    if (v >= count)
        return;
    float3 sum = load3(collected, path[v]);
    for (uint s = 0; s < slots; ++s) {
        const int ray = ray_of[v * slots + s];
        if (ray >= 0 && !blocked[ray])
            sum += load3(weight, v * slots + s);
    }
    store3(collected, path[v], sum);
}

// What ray i met: adds emission, weighted against having been chosen by connect, and makes the
// next vertex, number `vertex` of its path.
// `from_camera`: these are camera rays; emission counts in full (2), or not at all (1).
// `plain`: the surface at this vertex counts with albedo 1 (irradiance seen by a camera).
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void shade(
    uint count, uint vertex, uint last_vertex, uint from_camera, uint plain,
    __global const float *triangles, __global const float *materials,
    __global const float *texture_pixels, __global const int *images,
    int width, int height, __global const float *environment,
    __global const float *environment_density_, int environment_sampled,
    __global const int *hit_triangle, __global const float *hit_distance,
    __global const float *hit_u, __global const float *hit_v,
    __global const float *ray_direction, __global const float *ray_density,
    __global const int *ray_path, uint stride, __global const float *drawn,
    __global float *throughput, __global float *collected,
    __global float *origin, __global float *shading, __global float *geometric,
    __global int *path, volatile __global int *vertices GLOW_PARAM NORMAL_MAP_PARAM)
{
    __local int in_group, group_base;
    const uint i = get_global_id(0);
    if (get_local_id(0) == 0)
        in_group = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    int slot = -1;
    uint p = 0;
    Surface s;
    s.point = s.geometric = s.shading = (float3)(0.0f);
    if (i < count && ray_density[i] >= 0.0f) {
        p = ray_path[i];
        const float3 d = load3(ray_direction, i);
        const float by_cosine = ray_density[i];
        const float3 carried = load3(throughput, p);
        const int triangle = hit_triangle[i];
        if (triangle < 0) {
            if (from_camera != 1) {
                const float2 pixel = environment_pixel(d, width, height);
                float w = 1.0f;
                if (!from_camera && environment_sampled)
                    w = power_heuristic(by_cosine, environment_density(environment_density_, width,
                                                                       height, pixel));
                store3(collected, p, load3(collected, p) +
                       w * carried * environment_at(environment, width, height, pixel));
            }
        } else {
            s = surface_at(triangles, triangle, hit_u[i], hit_v[i]);
#if NORMAL_MAPS
            if (from_camera)
                s.shading = mapped_normal(normal_maps, triangle, hit_u[i], hit_v[i], s.shading,
                                          s.geometric);
#endif
            const float facing = -dot(s.geometric, d);
            if (facing > 0.0f) {
                __global const float *material = materials + s.material * MATERIAL_FLOATS;
                float emitter_density = material[7];
                float3 emission = load3(material, 1);
#if GLOW
                glow_at(glow, triangle, hit_u[i], hit_v[i], &emission, &emitter_density);
#endif
                if (emitter_density > 0.0f && from_camera != 1) {
                    float w = 1.0f;
                    if (!from_camera) {
                        const float t = hit_distance[i];
                        w = power_heuristic(by_cosine, emitter_density * t * t / facing);
                    }
                    store3(collected, p, load3(collected, p) + w * carried * emission);
                }
                if (vertex <= last_vertex) {
                    float3 albedo = (float3)(1.0f);
                    if (!plain) {
                        albedo = load3(material, 0);
                        const int texture = as_int(material[6]);
                        if (texture >= 0)
                            albedo *= texture_at(texture_pixels, images, texture, s.uv);
                    }
                    float3 left = carried * albedo;
                    float survival = max(left.x, max(left.y, left.z));
                    bool lives = survival > 0.0f;
                    if (vertex >= ROULETTE_AFTER && lives) {
                        survival = min(survival, ROULETTE_SURVIVAL);
                        lives = drawn[(size_t)stride * DRAWN_ROULETTE + i] < survival;
                        left /= survival;
                    }
                    if (lives) {
                        store3(throughput, p, left);
                        slot = atomic_inc(&in_group);
                    }
                }
            }
        }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (get_local_id(0) == 0)
        group_base = atomic_add(vertices, in_group);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (slot >= 0) {
        const int v = group_base + slot;
        store3(origin, v, leave_surface(s.point, s.geometric));
        store3(shading, v, s.shading);
        store3(geometric, v, s.geometric);
        path[v] = p;
    }
}

// The mean over each owner's samples of what their paths collected.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void average(uint owners, uint samples, __global const float *collected, __global float *mean)
{
    const uint o = get_global_id(0);
    if (o >= owners)
        return;
    float3 sum = (float3)(0.0f);
    for (uint s = 0; s < samples; ++s)
        sum += load3(collected, (size_t)o * samples + s);
    store3(mean, o, sum / (float)samples);
}

#endif
