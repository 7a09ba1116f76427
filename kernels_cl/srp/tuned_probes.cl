// Probe update as fast as we can: a small matrix product with gathered radiance.
// Macros: VEC, VECTORS (vectors of coefficients per work-item), SAMPLES (relight samples),
// CHUNK (samples held in local memory at once), STRIDE (coefficients padded to whole vectors).
#include "srp/relit.cl"
#include "srp/storage.cl"

// probe_update: one work-group per probe.
//   lambda[i][j] = sum over relight rays of radiance * Y_j * 4 pi / samples
// All work-items gather the radiance of CHUNK samples into local memory, one plane per channel; then
// every work-item sums VEC * VECTORS coefficients of all three channels over them, so that a basis
// value read once serves three products. Hits and misses are one list: what escapes reads the
// environment's radiance from behind the lightmap's texels, where it was put ahead.
// OCCLUDERS=1, where something moves: what a blocked ray sees is in `blocked` (srp/blocked_rays.cl).
//   updated      how many probes are updated, and these
//   source       (probes, SAMPLES) entry of `radiance` each ray sees
//   basis        (SAMPLES, STRIDE): Y_j times 4 pi / samples, zeros behind the last coefficient
//   radiance     lightmap of outgoing radiance, the environment's samples behind it, one black
//   lambda       (probes, 3, STRIDE), W/m2/sr
//   gathered     local, 3 * CHUNK floats
__kernel void probe_update(__global const int *updated, __global const int *source,
                           __global const float *basis, __global const float4 *radiance,
                           BLOCKED_PARAM __global float *lambda, __local float *gathered)
{
    const int item = get_local_id(0), items = get_local_size(0);
    const int probe = updated[1 + get_group_id(0)];
    __global const int *rays = source + (size_t)probe * SAMPLES;
    __local float *red = gathered, *green = gathered + CHUNK, *blue = gathered + 2 * CHUNK;
    for (int first = 0; first < SAMPLES; first += CHUNK) {
        const int count = min(CHUNK, SAMPLES - first);
        for (int i = item; i < count; i += items) {
            const float4 sample = relit(BLOCKED_ARG radiance, rays, probe, first + i);
            red[i] = sample.x;
            green[i] = sample.y;
            blue[i] = sample.z;
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int at = item * VECTORS * VEC; at < STRIDE; at += items * VECTORS * VEC) {
            __global float *out = lambda + (size_t)probe * 3 * STRIDE + at;
            vfloat r[VECTORS], g[VECTORS], b[VECTORS];
#pragma unroll
            for (int k = 0; k < VECTORS; ++k) {
                r[k] = first ? float_vector(k, out) : (vfloat)(0.0f);
                g[k] = first ? float_vector(k, out + STRIDE) : (vfloat)(0.0f);
                b[k] = first ? float_vector(k, out + 2 * STRIDE) : (vfloat)(0.0f);
            }
            __global const float *y = basis + (size_t)first * STRIDE + at;
            for (int i = 0; i < count; ++i, y += STRIDE) {
#pragma unroll
                for (int k = 0; k < VECTORS; ++k) {
                    const vfloat value = float_vector(k, y);
                    r[k] += red[i] * value;
                    g[k] += green[i] * value;
                    b[k] += blue[i] * value;
                }
            }
#pragma unroll
            for (int k = 0; k < VECTORS; ++k) {
                ((__global vfloat *)out)[k] = r[k];
                ((__global vfloat *)(out + STRIDE))[k] = g[k];
                ((__global vfloat *)(out + 2 * STRIDE))[k] = b[k];
            }
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
}
