// Captured probes lit anew from their G-buffers.
//
// Macros besides those of parts/captured_gather.cl: GATHERS (0: directly lit alone, one bounce),
// NO_FRONT, WEIGHT_UNITS (of a barycentric weight).
#include "common/bvh.cl"
#include "common/lights.cl"
#include "common/material.cl"
#include "common/sampling.cl"
#include "common/shade.cl"
#include "parts/captured_filter_layout.cl"
#include "parts/captured_gather.cl"

// probe_relight: one work-item per texel of a probe that is relit.
//   radiance = emission + albedo / pi (direct irradiance + what the probes hold there from the frame
//   before). McGuire et al. 2017, section 3, with the ray replaced by the texel's own surface.
// relit: (relit_count,) probes. captured_hits: (PROBES, TEXELS) triangle or NO_FRONT, and the weights of
// its corners 1 and 2 in 16 bits each. captured_albedo, captured_emission: (PROBES, TEXELS) of 4, the
// last not used. radiance: see parts/captured_filter_layout.cl.
__kernel void probe_relight(BVH_PARAMS, SHAPE_PARAMS, LIGHT_PARAMS, VOLUME_PARAMS, MAP_PARAMS,
                            __global const int *relit, int relit_count,
                            __global const uint2 *captured_hits,
                            __global const half *captured_albedo,
                            __global const half *captured_emission, __global float *radiance)
{
    const int i = get_global_id(0);
    if (i >= relit_count * TEXELS)
        return;
    const int slot = i / TEXELS, texel = i % TEXELS, probe = relit[slot];
    const size_t place = (size_t)probe * TEXELS + texel;
    float3 sent = vload_half4(place, captured_emission).xyz;
    const uint2 shown = captured_hits[place];
    if (shown.x != NO_FRONT) {
        const Hit hit = {0.0f, (shown.y & 0xffffu) / WEIGHT_UNITS, (shown.y >> 16) / WEIGHT_UNITS, (int)shown.x};
        const Surface s = surface_shape(SHAPE_ARGS, hit);
        const float3 direction = normalize(s.position - probe_position(VOLUME_ARGS, probe));
        float3 irradiance = direct_irradiance(BVH_ARGS, LIGHT_ARGS,
                                              back_along_ray(s.position, direction), s.normal,
                                              s.geometric_normal);
#if GATHERS
        irradiance +=
            probe_irradiance(VOLUME_ARGS, MAP_ARGS, s.position, s.geometric_normal, s.normal);
#endif
        sent = with_reflected(sent, vload_half4(place, captured_albedo).xyz, irradiance);
    }
    __global float *planes = radiance + (size_t)slot * 3 * STRIDE + texel;
    planes[0] = sent.x;
    planes[STRIDE] = sent.y;
    planes[2 * STRIDE] = sent.z;
}
