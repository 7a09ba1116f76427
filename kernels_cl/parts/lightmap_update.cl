// What every receiver sends out: the input of the next indirect bounce.
#include "common/bvh.cl"
#include "common/lightmap.cl"
#include "common/lights.cl"
#include "common/shade.cl"
#include "common/vec.cl"

// lightmap_update: one work-item per receiver.
//   radiance = emission + albedo / pi (direct irradiance + last frame's indirect irradiance)
// with shadow rays for the direct part; the indirect part is left out when bounces is 0.
// Bennett 2019, section 5.1, pass 1; Silvennoinen and Lehtinen 2017, section 4.2 ("infinite light
// bounces").
// position, normal, albedo, emission: (count, 3); texel: (count,) flat lightmap texels.
// indirect: a lightmap of COMPONENTS (common/lightmap.cl), of which the first counts; radiance: a
// lightmap of one; only receivers' texels are read and written.
__kernel void lightmap_update(BVH_PARAMS, LIGHT_PARAMS, __global const float *position,
                              __global const float *normal, __global const float *albedo,
                              __global const float *emission, __global const int *texel, int count,
                              __global const float4 *indirect, int bounces,
                              __global float4 *radiance)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const float3 n = load3(normal, i);
    float3 irradiance = direct_irradiance(BVH_ARGS, LIGHT_ARGS, load3(position, i), n, n);
    if (bounces)
        irradiance += indirect[COMPONENTS * texel[i]].xyz;
    const float3 out = with_reflected(load3(emission, i), load3(albedo, i), irradiance);
    radiance[texel[i]] = (float4)(out, 1.0f);
}
