// What the probes see: rays through the scene, and the light that comes back along them.
//
// Besides the macros of parts/probe_volume.cl: RAYS per probe, of which the first FIXED are not rotated and
// not blended, and BLENDED = RAYS - FIXED; LANES, see ddgi/rays.cl.
#include "common/bvh.cl"
#include "common/environment.cl"
#include "common/lights.cl"
#include "common/material.cl"
#include "common/sampling.cl"
#include "common/shade.cl"
#include "parts/probe_gather.cl"
#include "ddgi/rays.cl"

inline float3 triangle_normal(__global const float *positions, __global const int *triangles,
                              int triangle)
{
    const int3 c = vload3(triangle, triangles);
    const float3 p0 = load3(positions, c.x);
    return cross(load3(positions, c.y) - p0, load3(positions, c.z) - p0);
}

// probe_trace: one work-item per probe and ray.
//   The closest hit along every ray of a probe; an inactive one casts its fixed rays alone.
// directions: (RAYS, 3) unit. fixed_distance: (PROBES, FIXED) m, negative where a ray meets a back,
// FAR_AWAY where nothing. hits: (PROBES, BLENDED) distance, barycentrics, triangle (as an int).
// Majercik et al. 2019, section 4.1; RTXGI-DDGI 1.3.7.
__kernel void probe_trace(BVH_PARAMS, __global const float *positions,
                          __global const int *triangles, VOLUME_PARAMS,
                          __global const float *directions, __global float *fixed_distance,
                          __global float4 *hits)
{
    const int i = get_global_id(0);
    if (i >= PROBES * RAYS)
        return;
    const int probe = i / RAYS, ray = i % RAYS;
    if (ray >= FIXED && !(probe_state(probe_data, probe) & PROBE_ACTIVE))
        return;
    const float3 direction = load3(directions, ray);
    const Hit hit = bvh_closest(BVH_ARGS, probe_position(VOLUME_ARGS, probe), direction, INFINITY);
    if (ray >= FIXED) {
        hits[probe * BLENDED + ray - FIXED] = (float4)(hit.t, hit.u, hit.v, as_float(hit.triangle));
        return;
    }
    float distance = FAR_AWAY;
    if (hit.triangle >= 0) {
        const float3 normal = triangle_normal(positions, triangles, hit.triangle);
        distance = dot(normal, direction) < 0.0f ? hit.t : -hit.t;
    }
    fixed_distance[probe * FIXED + ray] = distance;
}

// probe_shade: one work-item per probe and rotated ray; inactive probes are left out.
//   radiance = emission + albedo / pi (direct irradiance + what last frame's probes give there),
// the environment on a miss, nothing on a back, whose distance is negative.
// rays: see ddgi/rays.cl. Majercik et al. 2019, section 4.2.
__kernel void probe_shade(BVH_PARAMS, SURFACE_PARAMS, LIGHT_PARAMS, ENVIRONMENT_PARAMS,
                          VOLUME_PARAMS, MAP_PARAMS, __global const float *directions,
                          __global const float4 *hits, __global float *rays)
{
    const int i = get_global_id(0);
    if (i >= PROBES * BLENDED)
        return;
    const int probe = i / BLENDED, ray = i % BLENDED;
    if (!(probe_state(probe_data, probe) & PROBE_ACTIVE))
        return;
    const float3 direction = load3(directions, FIXED + ray);
    const float4 packed = hits[i];
    const Hit hit = {packed.x, packed.y, packed.z, as_int(packed.w)};
    float3 radiance = (float3)(0.0f);
    float distance = FAR_AWAY;
    if (hit.triangle < 0) {
        radiance = environment_radiance(ENVIRONMENT_ARGS, direction);
    } else {
        const Surface s = surface_at(SURFACE_ARGS, hit);
        distance = -hit.t;
        if (dot(s.geometric_normal, direction) < 0.0f) {
            distance = hit.t;
            const float3 seen = back_along_ray(s.position, direction);
            const float3 bias = surface_bias(volume, s.geometric_normal, -direction);
            const float3 direct =
                direct_irradiance(BVH_ARGS, LIGHT_ARGS, seen, s.normal, s.geometric_normal);
            const float3 irradiance =
                direct + gathered_irradiance(VOLUME_ARGS, MAP_ARGS, s.position, bias, s.normal);
            radiance = with_reflected(s.emission, s.albedo, irradiance);
        }
    }
    store_ray(rays, probe, ray, radiance, distance, max_distance(volume));
}
