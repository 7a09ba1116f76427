// Light from wherever the space around a point is open, as the probes around it see that.
#include "common/material.cl"
#include "parts/probe_volume.cl"

// volume: see parts/probe_volume.cl. openness: (PROBES,) share of a probe's rays that meet nothing
// near. ambient: radiance that comes from there, W/m2/sr.
#define OPENNESS_PARAMS __global const float *volume, __global const float *openness, float ambient
#define OPENNESS_ARGS volume, openness, ambient

// Irradiance, W/m2, at a point: trilinear between eight probes; that of the grid's edge beyond it.
inline float3 open_irradiance(OPENNESS_PARAMS, float3 position)
{
    const int3 last = (int3)(PROBES_X - 1, PROBES_Y - 1, PROBES_Z - 1);
    const float3 place = (position - load3(volume, 0)) / load3(volume, 1);
    const float3 at = clamp(place, (float3)(0.0f), convert_float3(last));
    const int3 base = convert_int3_rtz(at);
    const float3 share = at - convert_float3(base);
    float sum = 0.0f;
    for (int i = 0; i < 8; ++i) {
        const int3 step = (int3)(i & 1, (i >> 1) & 1, i >> 2);
        const float3 weight = mix(1.0f - share, share, convert_float3(step));
        const int probe = probe_index(volume, min(base + step, last));
        sum += weight.x * weight.y * weight.z * openness[probe];
    }
    return (float3)(PI_F * ambient * sum);
}

// What the pass `application` of parts/apply.cl looks up at a pixel.
#define LOOKUP_PARAMS SHAPE_PARAMS, OPENNESS_PARAMS
#define LOOKUP_ARGS SHAPE_ARGS, OPENNESS_ARGS
inline float3 looked_up(LOOKUP_PARAMS, Hit hit, float3 direction)
{
    return open_irradiance(OPENNESS_ARGS, surface_shape(SHAPE_ARGS, hit).position);
}
#include "parts/apply.cl"

// receiver_openness: one work-item per receiver. position: (count, 3) m. irradiance: (count, 3) W/m2.
__kernel void receiver_openness(OPENNESS_PARAMS, __global const float *position, int count,
                                __global float *irradiance)
{
    const int i = get_global_id(0);
    if (i < count)
        store3(irradiance, i, open_irradiance(OPENNESS_ARGS, load3(position, i)));
}
