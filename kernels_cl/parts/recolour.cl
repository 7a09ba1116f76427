// Albedo and emission of places (a receiver's texel, a surfel, a captured texel) whose materials change.
//
// A program defines, and then includes this file:
//   STORE_PARAMS, STORE_ARGS      where they are kept
//   void store_colours(STORE_PARAMS, int place, float3 albedo, float3 emission)
#include "common/material.cl"

// recolour: one work-item per place that shows what changes.
//   albedo = rest + sum of share x the material's albedo, emission likewise: a texel has the mean over
//   what it covers, which is linear in every material's colours.
// materials: common/material.cl. places: (count,). starts: (count + 1,) into rows and shares: the
// materials that a place shows, and the share of each: what its albedo is multiplied with by channel
// (an image's mean in it), and its emission. rest: (count, 6) albedo and emission of all else.
__kernel void recolour(__global const float *materials, __global const int *places,
                       __global const int *starts, __global const int *rows,
                       __global const float4 *shares, __global const float *rest, int count,
                       STORE_PARAMS)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    float3 reflects = load3(rest, 2 * i), sends = load3(rest, 2 * i + 1);
    for (int k = starts[i]; k < starts[i + 1]; ++k) {
        const float4 share = shares[k];
        reflects += share.xyz * material_color(materials, rows[k], MATERIAL_BASE_COLOR);
        sends += share.w * material_color(materials, rows[k], MATERIAL_EMISSION);
    }
    store_colours(STORE_ARGS, places[i], reflects, sends);
}
