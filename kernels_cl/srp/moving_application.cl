// Indirect light on what the camera sees where something moves: from the lightmap on what rests, from
// the probes on what has no place in it.
// Macros: those of srp/probe_light.cl and parts/apply.cl.
#include "common/lightmap.cl"
#include "common/material.cl"
#include "srp/probe_light.cl"

#define LOOKUP_PARAMS LIGHTMAP_PARAMS, SHAPE_PARAMS, PROBE_LIGHT_PARAMS
#define LOOKUP_ARGS LIGHTMAP_ARGS, SHAPE_ARGS, PROBE_LIGHT_ARGS
inline float3 looked_up(LOOKUP_PARAMS, Hit hit, float3 direction)
{
    float2 at;
    if (lightmap_place(lightmap_uvs, hit, &at))
        return lightmap_bilinear(irradiance_map, lightmap_width, lightmap_height, at, 0);
    const Surface s = surface_shape(SHAPE_ARGS, hit);
    return probe_light(PROBE_LIGHT_ARGS, s.position, s.normal);
}
#include "parts/apply.cl"

// receiver_irradiance: one work-item per point; irradiance: (count, 3) W/m2.
//   The probes' light at receivers on what moves.
__kernel void receiver_irradiance(PROBE_LIGHT_PARAMS, __global const float *position,
                                  __global const float *normal, int count,
                                  __global float *irradiance)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    store3(irradiance, i, probe_light(PROBE_LIGHT_ARGS, load3(position, i), load3(normal, i)));
}
