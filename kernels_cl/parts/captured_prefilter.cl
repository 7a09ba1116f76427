// Radiance prefiltered for gloss, texel by texel of the maps.
//
// Macros: those of parts/captured_lobes.cl; VEC, floats per vector.
#include "common/vec_width.cl"
#include "parts/captured_filter_layout.cl"
#include "parts/captured_lobes.cl"

// prefilter: one work-item per texel of all steps of a probe that is relit.
//   The mean of radiance by D(h) n . l, where the eye looks along the normal (Karis 2013): h lies
//   halfway between n and l. A mirror's map is the radiance itself.
// relit: (relit_count,) probes. texel_table, radiance: see parts/captured_filter.cl.
__kernel void prefilter(__global const int *relit, int relit_count, int lobe_texels,
                        __global const float *texel_table, __global const float *radiance,
                        __global map_t *lobe_maps)
{
    const int i = get_global_id(0);
    if (i >= relit_count * lobe_texels)
        return;
    const int slot = i / lobe_texels, probe = relit[slot];
    int texel = i % lobe_texels, step = 0, side = SIDE;
    while (texel >= side * side) {
        texel -= side * side;
        side = lobe_side(++step);
    }
    __global const float *planes = radiance + (size_t)slot * 3 * STRIDE;
    const size_t place = lobe_first(step) + map_texel(probe, texel, side);
    if (step == 0) {
        const float4 sent =
            (float4)(planes[texel], planes[STRIDE + texel], planes[2 * STRIDE + texel], 0.0f);
        map_store4(sent, place, lobe_maps);
        return;
    }
    const float3 n = texel_direction(texel, side);
    const float alpha = lobe_alpha(step), squared = alpha * alpha;
    vfloat red = (vfloat)(0.0f), green = red, blue = red, weights = red;
    for (int j = 0; j < STRIDE; j += VEC) {
        const vfloat cosine = n.x * vec_load(0, texel_table + j) +
                              n.y * vec_load(0, texel_table + STRIDE + j) +
                              n.z * vec_load(0, texel_table + 2 * STRIDE + j);
        const vfloat off = 0.5f - 0.5f * cosine;
        const vfloat width = off + squared * (1.0f - off);
        const vfloat lit = fmax(cosine, (vfloat)(0.0f)) * vec_load(0, texel_table + 3 * STRIDE + j);
        const vfloat weight = lit / (width * width);
        red += weight * vec_load(0, planes + j);
        green += weight * vec_load(0, planes + STRIDE + j);
        blue += weight * vec_load(0, planes + 2 * STRIDE + j);
        weights += weight;
    }
    const float scale = 1.0f / vec_sum(weights);
    const float4 mean = scale * (float4)(vec_sum(red), vec_sum(green), vec_sum(blue), 0.0f);
    map_store4(mean, place, lobe_maps);
}
