// From radiance to irradiance, and from distances to their means: integrals over octahedral maps, texel
// by texel.
//
// texel_table: four planes of STRIDE floats: x, y, z of a texel's direction and its solid angle, sr; 0
// behind the last texel. Macros: SIDE, HALF_MAPS; VEC, floats per vector; OUTPUTS, texels that a work-item
// of filter_irradiance computes, which share what it reads (a divisor of SIDE^2).
#include "common/vec_width.cl"
#include "parts/captured_filter_layout.cl"
#include "parts/octahedral_maps.cl"
#include "parts/probe_volume.cl"

// filter_irradiance: one work-item per OUTPUTS texels of a probe that is relit.
//   E(n) = integral of L max(0, n . w) over all directions w, its weights made to sum to pi; a probe
//   that is filtered counts from then on.
// relit: (relit_count,) probes. radiance: see parts/captured_filter_layout.cl.
__kernel void filter_irradiance(__global const int *relit, int relit_count,
                                __global const float *texel_table,
                                __global const float *radiance, __global map_t *irradiance_maps,
                                __global float4 *probe_data)
{
    const int i = OUTPUTS * get_global_id(0);
    if (i >= relit_count * TEXELS)
        return;
    const int slot = i / TEXELS, texel = i % TEXELS, probe = relit[slot];
    __global const float *planes = radiance + (size_t)slot * 3 * STRIDE;
    vfloat red[OUTPUTS], green[OUTPUTS], blue[OUTPUTS], weights[OUTPUTS];
#pragma unroll
    for (int k = 0; k < OUTPUTS; ++k)
        red[k] = green[k] = blue[k] = weights[k] = (vfloat)(0.0f);
    for (int j = 0; j < STRIDE; j += VEC) {
        const vfloat x = vec_load(0, texel_table + j), y = vec_load(0, texel_table + STRIDE + j);
        const vfloat z = vec_load(0, texel_table + 2 * STRIDE + j);
        const vfloat angle = vec_load(0, texel_table + 3 * STRIDE + j);
        const vfloat r = vec_load(0, planes + j), g = vec_load(0, planes + STRIDE + j);
        const vfloat b = vec_load(0, planes + 2 * STRIDE + j);
#pragma unroll
        for (int k = 0; k < OUTPUTS; ++k) {
            const int own = texel + k;
            const vfloat cosine = texel_table[own] * x + texel_table[STRIDE + own] * y +
                                  texel_table[2 * STRIDE + own] * z;
            const vfloat weight = fmax(cosine, (vfloat)(0.0f)) * angle;
            red[k] += weight * r;
            green[k] += weight * g;
            blue[k] += weight * b;
            weights[k] += weight;
        }
    }
#pragma unroll
    for (int k = 0; k < OUTPUTS; ++k) {
        const float scale = PI_F / vec_sum(weights[k]);
        const float4 irradiance =
            scale * (float4)(vec_sum(red[k]), vec_sum(green[k]), vec_sum(blue[k]), 0.0f);
        map_store4(irradiance, map_texel(probe, texel + k, SIDE), irradiance_maps);
    }
    if (texel == 0)
        probe_data[probe].w = PROBE_ACTIVE | PROBE_BLENDED;
}

// filter_distance: one work-item per texel of a probe that is relit.
//   Means of distance and squared distance over the lobe (d . d')^sharpness; cosines below least_cosine
//   weigh too little to count.
// captured_moments: (PROBES, TEXELS) of 2.
__kernel void filter_distance(__global const int *relit, int relit_count,
                              __global const float *texel_table,
                              __global const float2 *captured_moments, float sharpness,
                              float least_cosine, __global map_t *distance_maps)
{
    const int i = get_global_id(0);
    if (i >= relit_count * TEXELS)
        return;
    const int texel = i % TEXELS, probe = relit[i / TEXELS];
    __global const float2 *own = captured_moments + (size_t)probe * TEXELS;
    const float x = texel_table[texel], y = texel_table[STRIDE + texel];
    const float z = texel_table[2 * STRIDE + texel];
    float2 sum = (float2)(0.0f);
    float weights = 0.0f;
    for (int j = 0; j < TEXELS; ++j) {
        const float cosine =
            x * texel_table[j] + y * texel_table[STRIDE + j] + z * texel_table[2 * STRIDE + j];
        if (cosine < least_cosine || cosine <= 0.0f)
            continue;
        const float weight = powr(fmin(cosine, 1.0f), sharpness);
        sum += weight * own[j];
        weights += weight;
    }
    map_store2(sum / weights, map_texel(probe, texel, SIDE), distance_maps);
}
