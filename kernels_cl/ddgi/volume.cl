// DDGI's probes: where they are and what they store.
//
// Macros: PROBES, COUNT_X, COUNT_Y, COUNT_Z; IRRADIANCE_SIDE and DISTANCE_SIDE (texels of a map's
// side without its border); HALF_STORAGE; DECODE_HALVES (gamma where it is a whole number, else 0)
// and DECODE (gamma / 2); NORMAL_BIAS, VIEW_BIAS, VISIBILITY_FLOOR, CRUSH_THRESHOLD; biases in m.
//
// volume           9 floats: origin, spacing (m), scroll (gibench.techniques.ddgi.volume)
// probe_data       per probe its offset from the grid (m) and its state (PROBE_ACTIVE and
//                  PROBE_BLENDED, added)
// irradiance_maps  per probe (side + 2)^2 texels of 4: (half the mean incoming radiance, weighed by
//                  the cosine)^(1/gamma), rows upwards; the fourth is not used
// distance_maps    per probe (side + 2)^2 texels of 2: mean and mean square of the distance, in
//                  units of max_distance, so that fp16 holds them in scenes of any size
#ifndef GIBENCH_DDGI_VOLUME
#define GIBENCH_DDGI_VOLUME

#include "common/octahedral.cl"
#include "common/vec.cl"

#define PROBE_ACTIVE 1  // casts all its rays
#define PROBE_BLENDED 2 // its maps hold something

#define IRRADIANCE_TEXELS (IRRADIANCE_SIDE * IRRADIANCE_SIDE)
#define DISTANCE_TEXELS (DISTANCE_SIDE * DISTANCE_SIDE)

#if HALF_STORAGE
typedef half map_t;
#define map_load4(i, p) vload_half4(i, p)
#define map_load2(i, p) vload_half2(i, p)
#define map_store4(v, i, p) vstore_half4(v, i, p)
#define map_store2(v, i, p) vstore_half2(v, i, p)
#else
typedef float map_t;
#define map_load4(i, p) vload4(i, p)
#define map_load2(i, p) vload2(i, p)
#define map_store4(v, i, p) vstore4(v, i, p)
#define map_store2(v, i, p) vstore2(v, i, p)
#endif

#define VOLUME_PARAMS __global const float *volume, __global const float4 *probe_data
#define VOLUME_ARGS volume, probe_data
#define MAP_PARAMS __global const map_t *irradiance_maps, __global const map_t *distance_maps
#define MAP_ARGS irradiance_maps, distance_maps

// Distances count up to half as far again as a cell's diagonal (RTXGI-DDGI 1.3.7).
inline float max_distance(__global const float *volume)
{
    return 1.5f * length(load3(volume, 1));
}

inline int scroll_along(__global const float *volume, int axis)
{
    return (int)volume[6 + axis];
}

// Where the data of the probe at grid coordinates `c` lie.
inline int probe_index(__global const float *volume, int3 c)
{
    const int x = (c.x + scroll_along(volume, 0)) % COUNT_X;
    const int y = (c.y + scroll_along(volume, 1)) % COUNT_Y;
    const int z = (c.z + scroll_along(volume, 2)) % COUNT_Z;
    return (z * COUNT_Y + y) * COUNT_X + x;
}

inline float3 grid_position(__global const float *volume, int3 c)
{
    return load3(volume, 0) + convert_float3(c) * load3(volume, 1);
}

// Position of a probe on the grid, without its offset.
inline float3 probe_grid_position(__global const float *volume, int probe)
{
    const int x = probe % COUNT_X, y = probe / COUNT_X % COUNT_Y, z = probe / (COUNT_X * COUNT_Y);
    return grid_position(volume, (int3)((x + COUNT_X - scroll_along(volume, 0)) % COUNT_X,
                                        (y + COUNT_Y - scroll_along(volume, 1)) % COUNT_Y,
                                        (z + COUNT_Z - scroll_along(volume, 2)) % COUNT_Z));
}

inline int probe_state(__global const float4 *probe_data, int probe)
{
    return (int)probe_data[probe].w;
}

inline float3 probe_position(VOLUME_PARAMS, int probe)
{
    return probe_grid_position(volume, probe) + probe_data[probe].xyz;
}

// Texel `texel` (row by row, without border) of a probe's map: its place among all maps' texels.
inline size_t map_texel(int probe, int texel, int side)
{
    const int across = side + 2;
    const int row = texel / side, column = texel % side;
    return (size_t)probe * across * across + (row + 1) * across + column + 1;
}

// The direction at the centre of a texel.
inline float3 texel_direction(int texel, int side)
{
    const float2 at = (float2)(texel % side + 0.5f, texel / side + 0.5f);
    return octahedral_decode(at * (2.0f / side) - 1.0f);
}

// Bilinear weights and upper left texel (border counted) of a direction in a map.
inline int map_corner(float3 direction, int side, float2 *fraction)
{
    const float2 at = (octahedral_encode(direction) * 0.5f + 0.5f) * side + 0.5f;
    const float2 corner = clamp(floor(at), 0.0f, (float)side);
    *fraction = at - corner;
    return (int)corner.y * (side + 2) + (int)corner.x;
}

// Stored irradiance to the square root of what it stands for. The probes' average is taken of
// these and squared afterwards (RTXGI-DDGI 1.3.7).
inline float4 decoded_root(float4 stored)
{
#if DECODE_HALVES
    float4 value = DECODE_HALVES % 2 ? sqrt(stored) : (float4)(1.0f);
    for (int i = 0; i < DECODE_HALVES / 2; ++i)
        value *= stored;
    return value;
#else
    return powr(stored, (float4)(DECODE));
#endif
}

// How far from the surface a gather is done, along the normal and towards the viewer.
inline float3 surface_bias(float3 normal, float3 towards_viewer)
{
    return normal * NORMAL_BIAS + towards_viewer * VIEW_BIAS;
}

// 1 within the volume, that is up to half a spacing outside the outermost probes, fading to 0 over
// the next spacing.
inline float volume_weight(__global const float *volume, float3 position)
{
    const float3 counts = (float3)(COUNT_X, COUNT_Y, COUNT_Z);
    const float3 at = (position - load3(volume, 0)) / load3(volume, 1) + 0.5f;
    const float3 outside = fmax(fmax(-at, at - counts), 0.0f);
    const float3 share = 1.0f - fmin(outside, 1.0f);
    return share.x * share.y * share.z;
}

// Bilinear value of a probe's irradiance map, as the square root of half the mean radiance.
//   first     the upper left texel's place among all maps' texels
//   fraction  from map_corner
inline float4 irradiance_root(__global const map_t *irradiance_maps, size_t first, float2 fraction)
{
    const size_t below = first + IRRADIANCE_SIDE + 2;
    const float4 upper = mix(map_load4(first, irradiance_maps),
                             map_load4(first + 1, irradiance_maps), fraction.x);
    const float4 lower = mix(map_load4(below, irradiance_maps),
                             map_load4(below + 1, irradiance_maps), fraction.x);
    return decoded_root(mix(upper, lower, fraction.y));
}

// Bilinear mean and mean square of the distance in a probe's map, from its upper left texel on.
inline float2 distance_moments(__global const map_t *distance_maps, size_t first, float2 fraction)
{
    // Two texels of two at a time.
    __global const map_t *upper = distance_maps + 2 * first;
    __global const map_t *lower = upper + 2 * (DISTANCE_SIDE + 2);
    const float4 both = mix(map_load4(0, upper), map_load4(0, lower), fraction.y);
    return mix(both.xy, both.zw, fraction.x);
}

#endif
