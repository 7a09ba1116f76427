// What is done per probe: relocation, classification, and the average variability.
#include "ddgi/rays.cl"
#include "parts/probe_maps.cl"
#include "parts/probe_volume.cl"

// relocation: one work-item per probe.
//   By its fixed rays: a probe inside a surface moves through the nearest back; one too near a
//   front steps towards the farthest; one with room goes back towards the grid. Offsets outside
//   0.45 spacings are not taken. RTXGI-DDGI 1.3.7, ProbeRelocationCS.
// fixed_distance: (PROBES, FIXED), see probe_trace. least_front: m.
__kernel void relocation(__global const float *volume, __global float4 *probe_data,
                         __global const float *directions, __global const float *fixed_distance,
                         float least_front)
{
    const int probe = get_global_id(0);
    if (probe >= PROBES)
        return;
    __global const float *distances = fixed_distance + probe * FIXED;
    int back = -1, front = -1, far = -1, backs = 0;
    float back_distance = FAR_AWAY, front_distance = FAR_AWAY, far_distance = 0.0f;
    for (int i = 0; i < FIXED; ++i) {
        const float d = distances[i];
        if (d < 0.0f) {
            ++backs;
            if (-d < back_distance)
                back_distance = -d, back = i;
        } else {
            if (d < front_distance)
                front_distance = d, front = i;
            if (d > far_distance)
                far_distance = d, far = i;
        }
    }
    float4 data = probe_data[probe];
    float3 offset = data.xyz;
    if (backs > FIXED_BACKFACE_THRESHOLD * FIXED) {
        offset += load3(directions, back) * (back_distance + 0.5f * least_front);
    } else if (front >= 0 && front_distance < least_front) {
        // Not where the way to the farthest leads along the nearest.
        const float3 away = load3(directions, far);
        if (dot(load3(directions, front), away) <= 0.5f)
            offset += away * fmin(far_distance, least_front);
    } else {
        const float length_now = length(offset);
        const float back_to_grid = fmin(front_distance - least_front, length_now);
        if (length_now > 0.0f)
            offset -= offset * (back_to_grid / length_now);
    }
    const float3 relative = offset / load3(volume, 1);
    if (dot(relative, relative) < 0.45f * 0.45f)
        data.xyz = offset;
    probe_data[probe] = data;
}

// classification: one work-item per probe.
//   A probe with too many backs around it is inside a surface; one without a front in its cell (a
//   spacing to every side) lights nothing: both become inactive. RTXGI-DDGI 1.3.7,
//   ProbeClassificationCS. A probe's maps count from the first frame that was blended.
// accepted: (PROBES,), see blend_irradiance. enabled: 0 leaves all probes active.
__kernel void classification(__global const float *volume, __global float4 *probe_data,
                             __global const float *directions,
                             __global const float *fixed_distance, __global const int *accepted,
                             int enabled)
{
    const int probe = get_global_id(0);
    if (probe >= PROBES)
        return;
    const int before = probe_state(probe_data, probe);
    int state = before & PROBE_BLENDED;
    if ((before & PROBE_ACTIVE) && accepted[probe])
        state = PROBE_BLENDED;
    bool active = !enabled;
    if (enabled) {
        __global const float *distances = fixed_distance + probe * FIXED;
        const float3 spacing = load3(volume, 1);
        int backs = 0;
        for (int i = 0; i < FIXED; ++i) {
            const float3 d = fabs(load3(directions, i));
            const float3 planes = spacing / fmax(d, 1e-6f);
            backs += distances[i] < 0.0f;
            active |= distances[i] >= 0.0f &&
                      distances[i] <= fmin(planes.x, fmin(planes.y, planes.z));
        }
        active &= backs <= FIXED_BACKFACE_THRESHOLD * FIXED;
    }
    probe_data[probe].w = state | (active ? PROBE_ACTIVE : 0);
}

// Sums of `value` and `count` over the group, any size; in item 0. Every work-item must call it.
inline void group_sum(float *value, uint *count, __local float *values, __local uint *counts)
{
    const int item = get_local_id(0);
    values[item] = *value;
    counts[item] = *count;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int left = get_local_size(0); left > 1; left = (left + 1) / 2) {
        const int half_way = (left + 1) / 2;
        if (item + half_way < left) {
            values[item] += values[item + half_way];
            counts[item] += counts[item + half_way];
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    *value = values[0];
    *count = counts[0];
}

// variability_sums: one work-item per SUM_ITEMS texels.
//   Per group: the sum over active, blended probes' coefficients of variation, and their number.
__kernel void variability_sums(__global const float4 *probe_data,
                               __global const float *variability, __global float *sums,
                               __global uint *counts, __local float *values,
                               __local uint *numbers)
{
    const int size = get_local_size(0);
    const int first = get_group_id(0) * size * SUM_ITEMS + get_local_id(0);
    float value = 0.0f;
    uint count = 0;
    for (int k = 0; k < SUM_ITEMS; ++k) {
        const int i = first + k * size;
        if (i < PROBES * IRRADIANCE_TEXELS &&
            probe_state(probe_data, i / IRRADIANCE_TEXELS) == (PROBE_ACTIVE | PROBE_BLENDED)) {
            value += variability[i];
            ++count;
        }
    }
    group_sum(&value, &count, values, numbers);
    if (get_local_id(0) == 0) {
        sums[get_group_id(0)] = value;
        counts[get_group_id(0)] = count;
    }
}

// variability_mean: one group; average[0] = the mean over all `groups` groups, 0 of none.
__kernel void variability_mean(__global const float *sums, __global const uint *counts, int groups,
                               __global float *average, __local float *values,
                               __local uint *numbers)
{
    float value = 0.0f;
    uint count = 0;
    for (int i = get_local_id(0); i < groups; i += get_local_size(0)) {
        value += sums[i];
        count += counts[i];
    }
    group_sum(&value, &count, values, numbers);
    if (get_local_id(0) == 0)
        average[0] = count ? value / count : 0.0f;
}
