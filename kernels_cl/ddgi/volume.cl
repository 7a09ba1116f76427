// DDGI's probes: where they are, what they store, and the eight-probe gather.
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

// Irradiance, W/m2, at a surface with unit normal: the eight probes around it, each weighed by
// trilinear distance, by how far it is in front of the surface and by the Chebyshev test on its
// distances. Majercik et al. 2019, "Dynamic Diffuse Global Illumination with Ray-Traced Irradiance
// Fields", section 5; constants of RTXGI-DDGI 1.3.7.
inline float3 gathered_irradiance(VOLUME_PARAMS, MAP_PARAMS, float3 position, float3 bias,
                                  float3 normal)
{
    const float3 spacing = load3(volume, 1);
    const int3 last = (int3)(COUNT_X - 1, COUNT_Y - 1, COUNT_Z - 1);
    const float3 biased = position + bias;
    const float longest = max_distance(volume);
    const int3 base = clamp(convert_int3_rtn((biased - load3(volume, 0)) / spacing), (int3)(0), last);
    const float3 alpha = clamp((biased - grid_position(volume, base)) / spacing, 0.0f, 1.0f);
    float2 f;
    const int corner = map_corner(normal, IRRADIANCE_SIDE, &f);
    float4 sum = (float4)(0.0f);
    float weights = 0.0f;
    for (int i = 0; i < 8; ++i) {
        const int3 step = (int3)(i & 1, (i >> 1) & 1, i >> 2);
        const int probe = probe_index(volume, min(base + step, last));
        const float4 data = probe_data[probe];
        if ((int)data.w != (PROBE_ACTIVE | PROBE_BLENDED))
            continue;
        const float3 at = probe_grid_position(volume, probe) + data.xyz;
        const float3 trilinear = fmax(mix(1.0f - alpha, alpha, convert_float3(step)), 0.001f);
        const float3 to_probe = at - position;
        const float facing =
            dot(to_probe, normal) * rsqrt(fmax(dot(to_probe, to_probe), 1e-12f)) * 0.5f + 0.5f;
        float weight = facing * facing + 0.2f;

        const float3 from_probe = biased - at;
        const float meters = fmax(length(from_probe), 1e-6f);
        float2 g;
        const int nearest = map_corner(from_probe / meters, DISTANCE_SIDE, &g);
        const size_t row = (size_t)probe * ((DISTANCE_SIDE + 2) * (DISTANCE_SIDE + 2)) + nearest;
        const float2 moments =
            mix(mix(map_load2(row, distance_maps), map_load2(row + 1, distance_maps), g.x),
                mix(map_load2(row + DISTANCE_SIDE + 2, distance_maps),
                    map_load2(row + DISTANCE_SIDE + 3, distance_maps), g.x),
                g.y);
        const float behind = meters / longest - moments.x;
        if (behind > 0.0f) {
            // Chebyshev's inequality bounds how much of the surface the probe sees.
            const float variance = fabs(moments.x * moments.x - moments.y);
            const float seen = variance / (variance + behind * behind);
            weight *= fmax(VISIBILITY_FLOOR, seen * seen * seen);
        }
        weight = fmax(weight, 1e-6f);
        if (weight < CRUSH_THRESHOLD)
            weight *= weight * weight * (1.0f / (CRUSH_THRESHOLD * CRUSH_THRESHOLD));
        weight *= trilinear.x * trilinear.y * trilinear.z;

        const size_t first = (size_t)probe * ((IRRADIANCE_SIDE + 2) * (IRRADIANCE_SIDE + 2)) + corner;
        const float4 stored =
            mix(mix(map_load4(first, irradiance_maps), map_load4(first + 1, irradiance_maps), f.x),
                mix(map_load4(first + IRRADIANCE_SIDE + 2, irradiance_maps),
                    map_load4(first + IRRADIANCE_SIDE + 3, irradiance_maps), f.x),
                f.y);
        sum += weight * decoded_root(stored);
        weights += weight;
    }
    if (weights <= 0.0f)
        return (float3)(0.0f);
    const float3 root = sum.xyz / weights;
    return root * root * (2.0f * PI_F * volume_weight(volume, position));
}

#endif
