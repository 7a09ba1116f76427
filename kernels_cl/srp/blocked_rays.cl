// Relight rays that what moves blocks, and what they see there.
// Macros besides those of srp/probe_light.cl: SAMPLES (relight rays of a probe).
#include "common/bvh.cl"
#include "common/lights.cl"
#include "common/material.cl"
#include "common/movers.cl"
#include "common/sampling.cl"
#include "common/shade.cl"
#include "srp/probe_light.cl"

// blocked_rays: one work-item per relight ray of a probe that is updated.
//   radiance = emission + albedo / pi (direct irradiance + what last frame's probes give there)
// of what moves where it lies in front of what the ray met when it was baked; nothing of a back. The
// probes' part is left out when bounces is 0. Silvennoinen and Lehtinen 2017, section 5.1, "Dynamic
// Occluders".
// updated: their number, and the probes. directions: (SAMPLES, 3). reach: (PROBES, SAMPLES) how far each
// ray goes until it meets what rests, m. blocked: (PROBES, SAMPLES) radiance, W/m2/sr, and 1 where the
// ray is blocked, else 0.
__kernel void blocked_rays(BVH_PARAMS, SURFACE_PARAMS, LIGHT_PARAMS, MOVER_PARAMS,
                           PROBE_LIGHT_PARAMS, __global const int *updated,
                           __global const float *directions, __global const float *reach,
                           int bounces, __global float4 *blocked)
{
    const int i = get_global_id(0);
    if (i >= updated[0] * SAMPLES)
        return;
    const int probe = updated[1 + i / SAMPLES], sample = i % SAMPLES;
    const size_t ray = (size_t)probe * SAMPLES + sample;
    const float3 direction = load3(directions, sample);
    float4 found = (float4)(0.0f);
    const Hit hit =
        bvh_closest(MOVER_BVH_ARGS, load3(probe_position, probe), direction, reach[ray]);
    if (hit.triangle >= 0) {
        found.w = 1.0f;
        const Surface s = surface_at(SURFACE_ARGS, hit);
        if (dot(s.geometric_normal, direction) < 0.0f) {
            float3 irradiance =
                direct_irradiance(BVH_ARGS, LIGHT_ARGS, back_along_ray(s.position, direction),
                                  s.normal, s.geometric_normal);
            if (bounces)
                irradiance += probe_light(PROBE_LIGHT_ARGS, s.position, s.normal);
            found.xyz = with_reflected(s.emission, s.albedo, irradiance);
        }
    }
    blocked[ray] = found;
}
