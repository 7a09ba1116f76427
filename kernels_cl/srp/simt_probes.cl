// Probe update for devices that run work-items in lockstep: a work-group per probe, neighbours on
// neighbouring coefficients, the samples shared out between rows of work-items.
// Macros: SAMPLES (relight samples), CHUNK (samples held in local memory at once), COEFFICIENTS.
#include "srp/relit.cl"

// probe_update: one work-group per probe.
//   lambda[i][j] = sum over relight rays of radiance * Y_j * 4 pi / samples
// All work-items gather the radiance of CHUNK samples into local memory, one plane per channel; then
// as many rows of work-items as the group has room for sum a share of them each, a coefficient to a
// work-item; the rows' sums are added up at the end. A group with less work-items than there are
// coefficients takes them in turns.
// OCCLUDERS=1, where something moves: what a blocked ray sees is in `blocked` (srp/blocked_rays.cl).
//   updated      how many probes are updated, and these
//   source       (probes, SAMPLES) entry of `radiance` each ray sees
//   basis        (SAMPLES, COEFFICIENTS): Y_j times 4 pi / samples
//   radiance     lightmap of outgoing radiance, the environment's samples behind it, one black
//   lambda       (probes, 3, COEFFICIENTS), W/m2/sr
//   gathered     local, 3 * CHUNK floats; partial: local, 3 floats per work-item
__kernel void probe_update(__global const int *updated, __global const int *source,
                           __global const float *basis, __global const float4 *radiance,
                           BLOCKED_PARAM __global float *lambda, __local float *gathered,
                           __local float *partial)
{
    const int item = get_local_id(0), items = get_local_size(0);
    const int width = min(items, COEFFICIENTS);
    const int shares = items / width, share = item / width;
    const int probe = updated[1 + get_group_id(0)];
    __global const int *rays = source + (size_t)probe * SAMPLES;
    __global float *out = lambda + (size_t)probe * 3 * COEFFICIENTS;
    __local float *red = gathered, *green = gathered + CHUNK, *blue = gathered + 2 * CHUNK;
    for (int turn = 0; turn < COEFFICIENTS; turn += width) {
        const int j = turn + item - share * width;
        const bool sums = share < shares && j < COEFFICIENTS;
        float r = 0.0f, g = 0.0f, b = 0.0f;
        for (int first = 0; first < SAMPLES; first += CHUNK) {
            const int count = min(CHUNK, SAMPLES - first);
            for (int i = item; i < count; i += items) {
                const float4 sample = relit(BLOCKED_ARG radiance, rays, probe, first + i);
                red[i] = sample.x;
                green[i] = sample.y;
                blue[i] = sample.z;
            }
            barrier(CLK_LOCAL_MEM_FENCE);
            for (int i = share; sums && i < count; i += shares) {
                const float y = basis[(size_t)(first + i) * COEFFICIENTS + j];
                r += red[i] * y;
                g += green[i] * y;
                b += blue[i] * y;
            }
            barrier(CLK_LOCAL_MEM_FENCE);
        }
        partial[item] = r;
        partial[items + item] = g;
        partial[2 * items + item] = b;
        barrier(CLK_LOCAL_MEM_FENCE);
        if (share == 0 && j < COEFFICIENTS) {
            for (int other = item + width; other < shares * width; other += width) {
                r += partial[other];
                g += partial[items + other];
                b += partial[2 * items + other];
            }
            out[j] = r;
            out[COEFFICIENTS + j] = g;
            out[2 * COEFFICIENTS + j] = b;
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
}
