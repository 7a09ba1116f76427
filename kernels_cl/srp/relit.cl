// What a probe's relight rays see. Macros: OCCLUDERS=1, where something moves: what a blocked ray sees
// is in `blocked` (srp/blocked_rays.cl), with w not 0; then SAMPLES (relight samples).
#ifndef GIBENCH_SRP_RELIT
#define GIBENCH_SRP_RELIT

#if OCCLUDERS
#define BLOCKED_PARAM __global const float4 *blocked,
#define BLOCKED_ARG blocked,
#else
#define BLOCKED_PARAM
#define BLOCKED_ARG
#endif

// Radiance that ray `sample` of `probe` sees; rays: the probe's entries of `radiance`.
inline float4 relit(BLOCKED_PARAM __global const float4 *radiance, __global const int *rays,
                    int probe, int sample)
{
#if OCCLUDERS
    const float4 before = blocked[(size_t)probe * SAMPLES + sample];
    return before.w == 0.0f ? radiance[rays[sample]] : before;
#else
    return radiance[rays[sample]];
#endif
}

#endif
