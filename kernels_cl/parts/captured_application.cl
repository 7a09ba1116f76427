// The captured probes' light where it is wanted: at the camera's pixels and the lightmap's receivers.
#include "common/bvh.cl"
#include "common/gloss.cl"
#include "common/material.cl"
#include "common/shade.cl"
#include "parts/captured_gather.cl"

#if LOBE_STEPS
// What the pass `application` of parts/apply.cl looks up at a pixel.
#define LOOKUP_PARAMS                                                                               \
    SHAPE_PARAMS, VOLUME_PARAMS, MAP_PARAMS, __global const map_t *lobe_maps,                       \
        __global const float *split_sum, __global const int *material_ids,                          \
        __global const float *materials GLOSS_PARAM
#define LOOKUP_ARGS \
    SHAPE_ARGS, VOLUME_ARGS, MAP_ARGS, lobe_maps, split_sum, material_ids, materials GLOSS_ARG
#define REFLECTED 1
inline float3 reflected(LOOKUP_PARAMS, Hit hit, float3 direction, float3 albedo)
{
    const Surface s = surface_shape(SHAPE_ARGS, hit);
    const float2 gloss = gloss_at(material_ids, materials GLOSS_ARG, hit);
    const float facing = dot(s.normal, direction);
    const float3 mirrored = normalize(direction - 2.0f * facing * s.normal);
    float3 received;
    const float3 irradiance = probe_irradiance(VOLUME_ARGS, MAP_ARGS, lobe_maps, mirrored, gloss.x,
                                               &received, s.position, s.geometric_normal, s.normal);
    const float3 share =
        glossy_share(split_sum, straight_reflectance(albedo, gloss.y), fabs(facing), gloss.x);
    return with_gloss((float3)(0.0f), albedo, irradiance, gloss.y, share, received);
}
#else
// What the pass `application` of parts/apply.cl looks up at a pixel.
#define LOOKUP_PARAMS SHAPE_PARAMS, VOLUME_PARAMS, MAP_PARAMS
#define LOOKUP_ARGS SHAPE_ARGS, VOLUME_ARGS, MAP_ARGS
inline float3 looked_up(LOOKUP_PARAMS, Hit hit, float3 direction)
{
    const Surface s = surface_shape(SHAPE_ARGS, hit);
    return probe_irradiance(VOLUME_ARGS, MAP_ARGS, s.position, s.geometric_normal, s.normal);
}
#endif
#include "parts/apply.cl"

#if !LOBE_STEPS
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
#endif
