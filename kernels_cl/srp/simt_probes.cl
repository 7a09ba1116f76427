// Probe update for devices that run work-items in lockstep: a work-group per probe and part of its
// samples, neighbours on neighbouring coefficients; a second kernel adds the parts' sums up.
// Macros: SAMPLES (relight samples), CHUNK (samples of a part, held in local memory), COEFFICIENTS,
// TEAM (work-items of a group that compute), STAGED=0 where a CPU makes vectors of work-items: one of
// them then has all coefficients and reads each radiance where it lies.
#include "srp/relit.cl"

#define PARTS ((SAMPLES + CHUNK - 1) / CHUNK)

// Rows of work-items that share a part's samples, where there are coefficients enough for one only.
#if TEAM >= 2 * COEFFICIENTS
#define SHARES (TEAM / COEFFICIENTS)
#else
#define SHARES 1
#endif

// Coefficients that a work-item sums at once, so that a radiance read from local memory serves them all.
#if COEFFICIENTS % (4 * TEAM) == 0
#define TOGETHER 4
#elif COEFFICIENTS % (2 * TEAM) == 0
#define TOGETHER 2
#else
#define TOGETHER 1
#endif

// Where each radiance is read where it lies, what the samples further on see is fetched meanwhile. Two
// cores of Zen 5, Sponza's sizes, radiance not in its caches: 0.82 ms without, 0.32 ms with.
#define SAMPLES_AHEAD 64
#ifdef __clang__
#define AHEAD(p) __builtin_prefetch(p, 0, 3);
#else
#define AHEAD(p)
#endif

// probe_update: one work-group per probe and part.
//   sums[group][j] = sum over the part's relight rays of radiance * Y_j * 4 pi / samples
// All work-items gather the radiance of the samples into local memory, one plane per channel; then
// each sums a coefficient, or several. Where a group has room for several rows of coefficients, these share the
// samples, and their sums are added up; one with less work-items than coefficients takes them in turns.
// Not STAGED, each radiance is read once for all coefficients by all work-items at once, and there is
// neither local memory nor a barrier.
// OCCLUDERS=1, where something moves: what a blocked ray sees is in `blocked` (srp/blocked_rays.cl).
//   updated      how many probes are updated, and these
//   source       (probes, SAMPLES) entry of `radiance` each ray sees
//   basis        (SAMPLES, COEFFICIENTS): Y_j times 4 pi / samples
//   radiance     lightmap of outgoing radiance, the environment's samples behind it, one black
//   sums         (probes that are updated, PARTS, 3, COEFFICIENTS), W/m2/sr
//   gathered     local, 3 * CHUNK floats; partial: local, 3 floats per work-item
__kernel void probe_update(__global const int *updated, __global const int *source,
                           __global const float *basis, __global const float4 *radiance,
                           BLOCKED_PARAM __global float *sums, __local float *gathered,
                           __local float *partial)
{
    // Not ints: see srp/simt_projection.cl.
    const size_t item = get_local_id(0);
    const int probe = updated[1 + get_group_id(0) / PARTS];
    const int first = (int)(get_group_id(0) % PARTS) * CHUNK;
    const int count = min(CHUNK, SAMPLES - first);
    __global const int *rays = source + (size_t)probe * SAMPLES;
    __global const float *y = basis + (size_t)first * COEFFICIENTS;
    __global float *out = sums + (size_t)get_group_id(0) * (3 * COEFFICIENTS);
#if STAGED
    __local float *red = gathered, *green = gathered + CHUNK, *blue = gathered + 2 * CHUNK;
    for (size_t turn = 0; turn < (size_t)count; turn += TEAM) {
        const size_t i = turn + item;
        if (i < (size_t)count) {
            const float4 sample = relit(BLOCKED_ARG radiance, rays, probe, first + (int)i);
            red[i] = sample.x;
            green[i] = sample.y;
            blue[i] = sample.z;
        }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
#else
    if (item >= TEAM)
        return;
#endif
#if SHARES == 1
    for (size_t turn = 0; turn < COEFFICIENTS; turn += TOGETHER * TEAM) {
        const size_t j = turn + item;
#if COEFFICIENTS % TEAM
        if (j >= COEFFICIENTS)
            continue;
#endif
        float r[TOGETHER], g[TOGETHER], b[TOGETHER];
#pragma unroll
        for (int k = 0; k < TOGETHER; ++k)
            r[k] = g[k] = b[k] = 0.0f;
        for (int i = 0; i < count; ++i) {
#if STAGED
            const float3 light = (float3)(red[i], green[i], blue[i]);
#else
            AHEAD(radiance + rays[min(first + i + SAMPLES_AHEAD, SAMPLES - 1)])
            const float4 light = relit(BLOCKED_ARG radiance, rays, probe, first + i);
#endif
#pragma unroll
            for (int k = 0; k < TOGETHER; ++k) {
                const float value = y[(size_t)(i * COEFFICIENTS + k * TEAM) + j];
                r[k] += light.x * value;
                g[k] += light.y * value;
                b[k] += light.z * value;
            }
        }
#pragma unroll
        for (int k = 0; k < TOGETHER; ++k) {
            out[k * TEAM + j] = r[k];
            out[COEFFICIENTS + k * TEAM + j] = g[k];
            out[2 * COEFFICIENTS + k * TEAM + j] = b[k];
        }
    }
#else
    const size_t share = item / COEFFICIENTS, j = item % COEFFICIENTS;
    float r = 0.0f, g = 0.0f, b = 0.0f;
    for (size_t i = share; share < SHARES && i < (size_t)count; i += SHARES) {
        const float value = y[i * COEFFICIENTS + j];
        r += red[i] * value;
        g += green[i] * value;
        b += blue[i] * value;
    }
    partial[item] = r;
    partial[TEAM + item] = g;
    partial[2 * TEAM + item] = b;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (share == 0) {
        for (int other = 1; other < SHARES; ++other) {
            r += partial[other * COEFFICIENTS + j];
            g += partial[TEAM + other * COEFFICIENTS + j];
            b += partial[2 * TEAM + other * COEFFICIENTS + j];
        }
        out[j] = r;
        out[COEFFICIENTS + j] = g;
        out[2 * COEFFICIENTS + j] = b;
    }
#endif
}

// add_parts: one work-group per probe that is updated.
//   lambda[probe] = sum over the parts of sums[probe's groups]
//   lambda  (probes, 3, COEFFICIENTS), W/m2/sr
__kernel void add_parts(__global const int *updated, __global const float *sums,
                        __global float *lambda)
{
    const size_t item = get_local_id(0);
    if (item >= TEAM)
        return;
    __global const float *own = sums + get_group_id(0) * (3 * COEFFICIENTS * PARTS);
    __global float *out = lambda + (size_t)updated[1 + get_group_id(0)] * (3 * COEFFICIENTS);
    for (size_t turn = 0; turn < 3 * COEFFICIENTS; turn += TEAM) {
        const size_t k = turn + item;
#if 3 * COEFFICIENTS % TEAM
        if (k >= 3 * COEFFICIENTS)
            continue;
#endif
        float sum = 0.0f;
        for (int part = 0; part < PARTS; ++part)
            sum += own[(size_t)(part * 3 * COEFFICIENTS) + k];
        out[k] = sum;
    }
}
