// Blending as products of matrices: texels x rays, the same for all probes in a frame, times
// rays x probes.
//
// All probes share a frame's ray directions, so a texel's weights are computed once, not once per
// probe. They are kept as lists of the rays that count: half of them for irradiance, about a
// seventh for distance. A work-item blends one texel of VEC probes at once, which lie beside each
// other (ddgi/rays.cl). Macros: VEC, LANES (a multiple of VEC), and that of ddgi/lists.cl.
#include "common/vec_width.cl"
#include "ddgi/lists.cl"

// blend_weights: one work-item per texel.
//   The list of each (ddgi/lists.cl).
// lengths: (texels,), multiples of LIST_STEP. list_rays, list_weights: (texels, LIST_LENGTH).
__kernel void blend_weights(__global const float *directions, int side, int sharp,
                            float least, __global int *lengths, __global int *list_rays,
                            __global float *list_weights)
{
    const int texel = get_global_id(0);
    if (texel >= side * side)
        return;
    lengths[texel] = make_list(texel, side, sharp, least, directions, list_rays, list_weights);
}

// Which work-item this is: a texel of VEC probes from `probe` on; false past the end.
inline bool blend_item(int texels, int *probe, int *texel)
{
    const int vectors = LANES / VEC;
    const int i = get_global_id(0);
    const int block = i / (texels * vectors);
    *texel = i / vectors % texels;
    *probe = block * LANES + i % vectors * VEC;
    if (*probe >= PROBES)
        return false;
    return true;
}

inline bool any_active(__global const float4 *probe_data, int probe)
{
    const int end = min(probe + VEC, PROBES);
    for (int i = probe; i < end; ++i)
        if (probe_state(probe_data, i) & PROBE_ACTIVE)
            return true;
    return false;
}

// The rows of a probe's rays.
inline __global const float *ray_planes(__global const float *rays, int probe)
{
    return rays + (size_t)(probe / LANES) * BLENDED * (RAY_PLANES * LANES) + probe % LANES;
}

// backface_counts: one work-item per probe; counts: (PROBES,).
__kernel void backface_counts(__global const float *rays, __global float *counts)
{
    const int probe = get_global_id(0);
    if (probe >= PROBES)
        return;
    __global const float *front = ray_planes(rays, probe) + 3 * LANES;
    float fronts = 0.0f;
    for (int ray = 0; ray < BLENDED; ++ray)
        fronts += front[ray * RAY_PLANES * LANES];
    counts[probe] = BLENDED - fronts;
}

// blend_irradiance: one work-item per texel and VEC probes.
__kernel void blend_irradiance(VOLUME_PARAMS, __global const int *lengths,
                               __global const int *list_rays, __global const float *list_weights,
                               __global const float *rays, __global const float *backs,
                               __global const uint *frame_table, __global map_t *irradiance_maps,
                               __global float *variability, __global int *accepted)
{
    int probe, texel;
    if (!blend_item(IRRADIANCE_TEXELS, &probe, &texel) || !any_active(probe_data, probe))
        return;
    __global const float *planes = ray_planes(rays, probe);
    __global const int *own_rays = list_rays + texel * LIST_LENGTH;
    __global const float *own_weights = list_weights + texel * LIST_LENGTH;
    const int length = lengths[texel];
    vfloat red = 0.0f, green = 0.0f, blue = 0.0f, weights = 0.0f;
    vfloat red1 = 0.0f, green1 = 0.0f, blue1 = 0.0f, weights1 = 0.0f;
    for (int i = 0; i < length; i += 2) {
        __global const float *row = planes + own_rays[i] * (RAY_PLANES * LANES);
        __global const float *row1 = planes + own_rays[i + 1] * (RAY_PLANES * LANES);
        const float w = own_weights[i], w1 = own_weights[i + 1];
        red += w * vec_load(0, row);
        green += w * vec_load(0, row + LANES);
        blue += w * vec_load(0, row + 2 * LANES);
        weights += w * vec_load(0, row + 3 * LANES);
        red1 += w1 * vec_load(0, row1);
        green1 += w1 * vec_load(0, row1 + LANES);
        blue1 += w1 * vec_load(0, row1 + 2 * LANES);
        weights1 += w1 * vec_load(0, row1 + 3 * LANES);
    }
    const vfloat scale = 0.5f / fmax(weights + weights1, (vfloat)(LEAST_WEIGHTS));
    float samples[3 * VEC];
    vec_store(sample_of((red + red1) * scale), 0, samples);
    vec_store(sample_of((green + green1) * scale), 0, samples + VEC);
    vec_store(sample_of((blue + blue1) * scale), 0, samples + 2 * VEC);
    const int count = min(VEC, PROBES - probe);
    for (int lane = 0; lane < count; ++lane) {
        const int state = probe_state(probe_data, probe + lane);
        if (state & PROBE_ACTIVE) {
            const float3 sample =
                (float3)(samples[lane], samples[VEC + lane], samples[2 * VEC + lane]);
            update_irradiance(probe + lane, texel, sample, backs[probe + lane],
                              !(state & PROBE_BLENDED), frame_table, irradiance_maps, variability,
                              accepted);
        }
    }
}

// blend_distance: one work-item per texel and VEC probes.
__kernel void blend_distance(VOLUME_PARAMS, __global const int *lengths,
                             __global const int *list_rays, __global const float *list_weights,
                             __global const float *rays, __global const uint *frame_table,
                             __global map_t *distance_maps)
{
    int probe, texel;
    if (!blend_item(DISTANCE_TEXELS, &probe, &texel) || !any_active(probe_data, probe))
        return;
    __global const float *planes = ray_planes(rays, probe) + 4 * LANES;
    __global const int *own_rays = list_rays + texel * LIST_LENGTH;
    __global const float *own_weights = list_weights + texel * LIST_LENGTH;
    const int length = lengths[texel];
    vfloat mean[LIST_STEP], square[LIST_STEP];
    float weights = 0.0f;
#pragma unroll
    for (int k = 0; k < LIST_STEP; ++k)
        mean[k] = square[k] = (vfloat)(0.0f);
    for (int i = 0; i < length; i += LIST_STEP) {
#pragma unroll
        for (int k = 0; k < LIST_STEP; ++k) {
            __global const float *row = planes + own_rays[i + k] * (RAY_PLANES * LANES);
            const float w = own_weights[i + k];
            mean[k] += w * vec_load(0, row);
            square[k] += w * vec_load(0, row + LANES);
            weights += w;
        }
    }
    float sums[2 * VEC];
    vec_store((mean[0] + mean[1]) + (mean[2] + mean[3]), 0, sums);
    vec_store((square[0] + square[1]) + (square[2] + square[3]), 0, sums + VEC);
    const int count = min(VEC, PROBES - probe);
    for (int lane = 0; lane < count; ++lane) {
        const int state = probe_state(probe_data, probe + lane);
        if (state & PROBE_ACTIVE)
            update_distance(probe + lane, texel, (float2)(sums[lane], sums[VEC + lane]), weights,
                            !(state & PROBE_BLENDED), frame_table, distance_maps);
    }
}
