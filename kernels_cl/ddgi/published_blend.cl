// Blending as the public SDK does it: a group per probe, its rays staged in local memory.
//
// CHUNK rays are staged at a time, as many as the profile's local memory holds. Every work-item
// reaches every barrier: what a group does depends on its probe alone, and what a work-item has no
// texel for it leaves out between barriers.
#include "ddgi/rays.cl"
#include "ddgi/texel.cl"

// blend_irradiance: one work-group per probe, texels shared out over its work-items.
//   Every texel's mean of the radiance of rays that met no back, weighed by max(0, cosine), blended
//   into the map. Majercik et al. 2019, section 4.3, equation 1.
// directions: (RAYS, 3). rays: (PROBES, BLENDED) float4. frame_table: see ddgi/texel.cl.
// variability: (PROBES, texels). accepted: (PROBES,), 1 where the probe was updated.
// staged: 7 * CHUNK floats.
__kernel void blend_irradiance(VOLUME_PARAMS, __global const float *directions,
                               __global const float *rays, __global const uint *frame_table,
                               __global map_t *irradiance_maps, __global float *variability,
                               __global int *accepted, __local float *staged)
{
    const int probe = get_group_id(0), item = get_local_id(0), size = get_local_size(0);
    const int state = probe_state(probe_data, probe);
    const int batches = state & PROBE_ACTIVE ? (IRRADIANCE_TEXELS + size - 1) / size : 0;
    for (int batch = 0; batch < batches; ++batch) {
        const int texel = batch * size + item;
        const float3 towards = texel_direction(texel, IRRADIANCE_SIDE);
        float4 sum = (float4)(0.0f);
        float backs = 0.0f;
        for (int first = 0; first < BLENDED; first += CHUNK) {
            const int count = min(CHUNK, BLENDED - first);
            for (int i = item; i < count; i += size) {
                const float4 ray = vload4((size_t)probe * BLENDED + first + i, rays);
                const float3 direction = load3(directions, FIXED + first + i);
                vstore3(direction, i, staged);
                vstore4(ray, i, staged + 3 * CHUNK);
            }
            barrier(CLK_LOCAL_MEM_FENCE);
            if (texel < IRRADIANCE_TEXELS) {
                for (int i = 0; i < count; ++i) {
                    const float4 ray = vload4(i, staged + 3 * CHUNK);
                    if (ray.w < 0.0f) {
                        backs += 1.0f;
                        continue;
                    }
                    const float weight = fmax(0.0f, dot(towards, vload3(i, staged)));
                    sum += weight * (float4)(ray.xyz, 1.0f);
                }
            }
            barrier(CLK_LOCAL_MEM_FENCE);
        }
        const float4 mean = sum / (2.0f * fmax(sum.w, LEAST_WEIGHTS));
        const float4 sample = sample_of(mean);
        if (texel < IRRADIANCE_TEXELS)
            update_irradiance(probe, texel, sample.xyz, backs, !(state & PROBE_BLENDED), frame_table,
                              irradiance_maps, variability, accepted);
    }
}

// blend_distance: as blend_irradiance, for mean and mean square of the distance, weighed by a power
// of the cosine. staged: 4 * CHUNK floats.
__kernel void blend_distance(VOLUME_PARAMS, __global const float *directions,
                             __global const float *rays, __global const uint *frame_table,
                             __global map_t *distance_maps, __local float *staged)
{
    const int probe = get_group_id(0), item = get_local_id(0), size = get_local_size(0);
    const int state = probe_state(probe_data, probe);
    const int batches = state & PROBE_ACTIVE ? (DISTANCE_TEXELS + size - 1) / size : 0;
    const float longest = max_distance(volume);
    for (int batch = 0; batch < batches; ++batch) {
        const int texel = batch * size + item;
        const float3 towards = texel_direction(texel, DISTANCE_SIDE);
        float2 sum = (float2)(0.0f);
        float weights = 0.0f;
        for (int first = 0; first < BLENDED; first += CHUNK) {
            const int count = min(CHUNK, BLENDED - first);
            for (int i = item; i < count; i += size) {
                const float distance = rays[4 * ((size_t)probe * BLENDED + first + i) + 3];
                const float3 direction = load3(directions, FIXED + first + i);
                vstore4((float4)(direction, blended_distance(distance, longest)), i, staged);
            }
            barrier(CLK_LOCAL_MEM_FENCE);
            if (texel < DISTANCE_TEXELS) {
                for (int i = 0; i < count; ++i) {
                    const float4 ray = vload4(i, staged);
                    const float weight = cosine_power(fmax(0.0f, dot(towards, ray.xyz)));
                    sum += weight * (float2)(ray.w, ray.w * ray.w);
                    weights += weight;
                }
            }
            barrier(CLK_LOCAL_MEM_FENCE);
        }
        if (texel < DISTANCE_TEXELS)
            update_distance(probe, texel, sum, weights, !(state & PROBE_BLENDED), frame_table,
                            distance_maps);
    }
}
