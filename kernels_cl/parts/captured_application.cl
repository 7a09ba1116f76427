// The captured probes' light where it is wanted: at the camera's pixels and the lightmap's receivers.
#include "common/bvh.cl"
#include "common/material.cl"
#include "parts/captured_gather.cl"

// What the pass `application` of parts/apply.cl looks up at a pixel.
#define LOOKUP_PARAMS SHAPE_PARAMS, VOLUME_PARAMS, MAP_PARAMS
#define LOOKUP_ARGS SHAPE_ARGS, VOLUME_ARGS, MAP_ARGS
inline float3 looked_up(LOOKUP_PARAMS, Hit hit, float3 direction)
{
    const Surface s = surface_shape(SHAPE_ARGS, hit);
    return probe_irradiance(VOLUME_ARGS, MAP_ARGS, s.position, s.geometric_normal, s.normal);
}
#include "parts/apply.cl"

// receiver_irradiance: one work-item per receiver; irradiance: (count, 3) W/m2.
__kernel void receiver_irradiance(VOLUME_PARAMS, MAP_PARAMS, __global const float *position,
                                  __global const float *normal, int count,
                                  __global float *irradiance)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const float3 n = load3(normal, i);
    store3(irradiance, i, probe_irradiance(VOLUME_ARGS, MAP_ARGS, load3(position, i), n, n));
}
