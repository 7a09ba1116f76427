// A regular grid of probes: where they are, and which of them hold something.
//
// Macros: PROBES, PROBES_X, PROBES_Y, PROBES_Z (probes along each axis); PROBE_ACTIVE (casts all its rays)
// and PROBE_BLENDED (its maps hold something).
//
// volume      9 floats: origin, spacing (m), scroll (gibench.techniques.parts.probe_volume); then 3 that
//             lookups take (parts/probe_gather.cl, parts/captured_gather.cl)
// probe_data  per probe its offset from the grid (m) and its state (PROBE_ACTIVE and PROBE_BLENDED,
//             added)
#ifndef GIBENCH_PROBE_VOLUME
#define GIBENCH_PROBE_VOLUME

#include "common/vec.cl"

#define VOLUME_PARAMS __global const float *volume, __global const float4 *probe_data
#define VOLUME_ARGS volume, probe_data

// Distances count up to half as far again as a cell's diagonal (RTXGI-DDGI 1.3.7).
inline float max_distance(__global const float *volume)
{
    return 1.5f * length(load3(volume, 1));
}

inline int scroll_along(__global const float *volume, int axis)
{
    return (int)volume[6 + axis];
}

// One of what lookups take, behind the volume.
inline float volume_length(__global const float *volume, int which)
{
    return volume[9 + which];
}

// Where the data of the probe at grid coordinates `c` lie.
inline int probe_index(__global const float *volume, int3 c)
{
    const int x = (c.x + scroll_along(volume, 0)) % PROBES_X;
    const int y = (c.y + scroll_along(volume, 1)) % PROBES_Y;
    const int z = (c.z + scroll_along(volume, 2)) % PROBES_Z;
    return (z * PROBES_Y + y) * PROBES_X + x;
}

inline float3 grid_position(__global const float *volume, int3 c)
{
    return load3(volume, 0) + convert_float3(c) * load3(volume, 1);
}

// Position of a probe on the grid, without its offset.
inline float3 probe_grid_position(__global const float *volume, int probe)
{
    const int x = probe % PROBES_X, y = probe / PROBES_X % PROBES_Y, z = probe / (PROBES_X * PROBES_Y);
    return grid_position(volume, (int3)((x + PROBES_X - scroll_along(volume, 0)) % PROBES_X,
                                        (y + PROBES_Y - scroll_along(volume, 1)) % PROBES_Y,
                                        (z + PROBES_Z - scroll_along(volume, 2)) % PROBES_Z));
}

inline int probe_state(__global const float4 *probe_data, int probe)
{
    return (int)probe_data[probe].w;
}

inline float3 probe_position(VOLUME_PARAMS, int probe)
{
    return probe_grid_position(volume, probe) + probe_data[probe].xyz;
}

// 1 within the volume, that is up to half a spacing outside the outermost probes, fading to 0 over
// the next spacing.
inline float volume_weight(__global const float *volume, float3 position)
{
    const float3 counts = (float3)(PROBES_X, PROBES_Y, PROBES_Z);
    const float3 at = (position - load3(volume, 0)) / load3(volume, 1) + 0.5f;
    const float3 outside = fmax(fmax(-at, at - counts), 0.0f);
    const float3 share = 1.0f - fmin(outside, 1.0f);
    return share.x * share.y * share.z;
}

#endif
