// Probe update as published (Bennett 2019, section 5.2, source code 5.3).
#include "common/environment.cl"
#include "common/vec.cl"
#include "srp/relit.cl"

// probe_update: one work-group per probe.
//   lambda[i][j] = sum over relight rays of radiance * Y_j * 4 pi / samples
// Every work-item sums its share of the probe's hits, then of its misses, into local memory of its
// own; after a barrier the first work-items add up the shares, one coefficient each. CHUNK
// coefficients fit the local memory at once (Bennett keeps all); chunks follow one another.
// OCCLUDERS=1, where something moves: what a blocked ray sees is in `blocked` (srp/blocked_rays.cl), and
// rays that would see nothing are among the hits, with a texel below 0. SAMPLES: rays of a probe.
//   updated       how many probes are updated, and these
//   hit_start     (probes + 1,) into hit_sample and hit_texel: the rays that meet a receiver
//   miss_start    (probes + 1,) into miss_sample: the rays that escape to the environment
//   directions    (samples, 3); basis (samples, coefficients): Y_j times 4 pi / samples
//   radiance      lightmap of outgoing radiance
//   lambda        (probes, coefficients, 3), W/m2/sr
//   sums          local, 3 * CHUNK floats per work-item
__kernel void probe_update(__global const int *updated, __global const int *hit_start,
                           __global const int *hit_sample, __global const int *hit_texel,
                           __global const int *miss_start, __global const int *miss_sample,
                           __global const float *directions, __global const float *basis,
                           int coefficients, __global const float4 *radiance, ENVIRONMENT_PARAMS,
                           BLOCKED_PARAM __global float *lambda, __local float *sums)
{
    const int item = get_local_id(0), items = get_local_size(0);
    const int probe = updated[1 + get_group_id(0)];
    __local float *own = sums + item * 3 * CHUNK;
    for (int first = 0; first < coefficients; first += CHUNK) {
        const int count = min(CHUNK, coefficients - first);
        for (int j = 0; j < 3 * CHUNK; ++j)
            own[j] = 0.0f;
        for (int i = hit_start[probe] + item; i < hit_start[probe + 1]; i += items) {
#if OCCLUDERS
            const float4 before = blocked[(size_t)probe * SAMPLES + hit_sample[i]];
            float3 sample = before.xyz;
            if (before.w == 0.0f)
                sample = hit_texel[i] < 0 ? (float3)(0.0f) : radiance[hit_texel[i]].xyz;
#else
            const float3 sample = radiance[hit_texel[i]].xyz;
#endif
            __global const float *y = basis + (size_t)hit_sample[i] * coefficients + first;
            for (int j = 0; j < count; ++j) {
                own[3 * j] += sample.x * y[j];
                own[3 * j + 1] += sample.y * y[j];
                own[3 * j + 2] += sample.z * y[j];
            }
        }
        for (int i = miss_start[probe] + item; i < miss_start[probe + 1]; i += items) {
#if OCCLUDERS
            const float4 before = blocked[(size_t)probe * SAMPLES + miss_sample[i]];
            float3 sample = before.xyz;
            if (before.w == 0.0f)
                sample = environment_radiance(ENVIRONMENT_ARGS, load3(directions, miss_sample[i]));
#else
            const float3 sample =
                environment_radiance(ENVIRONMENT_ARGS, load3(directions, miss_sample[i]));
#endif
            __global const float *y = basis + (size_t)miss_sample[i] * coefficients + first;
            for (int j = 0; j < count; ++j) {
                own[3 * j] += sample.x * y[j];
                own[3 * j + 1] += sample.y * y[j];
                own[3 * j + 2] += sample.z * y[j];
            }
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        // One coefficient each; more rounds where the group is smaller than the chunk.
        for (int j = item; j < count; j += items) {
            float3 total = (float3)(0.0f);
            for (int k = 0; k < items; ++k) {
                __local const float *share = sums + k * 3 * CHUNK + 3 * j;
                total += (float3)(share[0], share[1], share[2]);
            }
            store3(lambda, (size_t)probe * coefficients + first + j, total);
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
}
