// The light that a volume's probes hold, at a surface.
//
// Irradiance, W/m2, at a surface with unit normal: the eight probes around it, each weighed by
// trilinear distance, by how far it is in front of the surface and by the Chebyshev test on its
// distances. Majercik et al. 2019, "Dynamic Diffuse Global Illumination with Ray-Traced Irradiance
// Fields", section 5; constants of RTXGI-DDGI 1.3.7.
//
// Macros besides those of parts/probe_volume.cl and parts/probe_maps.cl: VISIBILITY_FLOOR,
// CRUSH_THRESHOLD (0: weights stay); VEC (1 as published): from 8 on, the weights of the eight probes are
// computed at once. Lengths behind the volume: the biases along the normal and towards the viewer, m.
#ifndef GIBENCH_PROBE_GATHER
#define GIBENCH_PROBE_GATHER

#include "parts/probe_maps.cl"
#include "parts/probe_volume.cl"

#define LEAST_TRILINEAR 0.001f
#define LEAST_WEIGHT 1e-6f

#if PROBE_VISIBILITY
#define MAP_PARAMS __global const map_t *irradiance_maps, __global const map_t *distance_maps
#define MAP_ARGS irradiance_maps, distance_maps
#else
#define MAP_PARAMS __global const map_t *irradiance_maps
#define MAP_ARGS irradiance_maps
#endif

// How far from the surface a gather is done, along the normal and towards the viewer.
inline float3 surface_bias(__global const float *volume, float3 normal, float3 towards_viewer)
{
    return normal * volume_length(volume, 0) + towards_viewer * volume_length(volume, 1);
}

// Bilinear value of a probe's irradiance map as it is averaged over probes: half the mean radiance
// where LINEAR, else its square root.
//   first     the upper left texel's place among all maps' texels
//   fraction  from map_corner
inline float4 irradiance_term(__global const map_t *irradiance_maps, size_t first, float2 fraction)
{
    const size_t below = first + IRRADIANCE_SIDE + 2;
#if LINEAR
    const float4 a = decoded_root(map_load4(first, irradiance_maps));
    const float4 b = decoded_root(map_load4(first + 1, irradiance_maps));
    const float4 c = decoded_root(map_load4(below, irradiance_maps));
    const float4 d = decoded_root(map_load4(below + 1, irradiance_maps));
    return mix(mix(a * a, b * b, fraction.x), mix(c * c, d * d, fraction.x), fraction.y);
#else
    const float4 upper = mix(map_load4(first, irradiance_maps),
                             map_load4(first + 1, irradiance_maps), fraction.x);
    const float4 lower = mix(map_load4(below, irradiance_maps),
                             map_load4(below + 1, irradiance_maps), fraction.x);
    return decoded_root(mix(upper, lower, fraction.y));
#endif
}

// An average of such values to half the mean radiance.
inline float3 averaged(float3 mean)
{
#if LINEAR
    return mean;
#else
    return mean * mean;
#endif
}

#if PROBE_VISIBILITY
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

#if VEC >= 8

#define EACH_OF_EIGHT(at) at(0) at(1) at(2) at(3) at(4) at(5) at(6) at(7)
#define OF_EIGHT(at) (at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7))

// Grid coordinates of the eight probes along one axis.
inline int8 eight_cells(int base, int8 step, int last)
{
    const int8 c = base + step;
    return c > (int8)(last) ? (int8)(last) : c;
}

// The coordinate's place in the data, as probe_index has it.
inline int8 eight_scrolled(int8 cells, int scroll, int count)
{
    const int8 c = cells + scroll;
    return c >= (int8)(count) ? c - (int8)(count) : c;
}

inline float8 eight_trilinear(float alpha, int8 step)
{
    return fmax(step != (int8)(0) ? (float8)(alpha) : (float8)(1.0f - alpha), LEAST_TRILINEAR);
}

#if PROBE_VISIBILITY
// One coordinate of octahedral_encode, as the place among a map's texels that map_corner takes it for.
inline float8 eight_texels(float8 along, float8 across, float8 z)
{
    const float8 folded = copysign(1.0f - fabs(across), along);
    return ((z < 0.0f ? folded : along) * 0.5f + 0.5f) * DISTANCE_SIDE + 0.5f;
}
#endif

inline float3 gathered_irradiance(VOLUME_PARAMS, MAP_PARAMS, float3 position, float3 bias,
                                  float3 normal)
{
    const float3 origin = load3(volume, 0), spacing = load3(volume, 1);
    const int3 last = (int3)(PROBES_X - 1, PROBES_Y - 1, PROBES_Z - 1);
    const float3 biased = position + bias;
    const int3 base = clamp(convert_int3_rtn((biased - origin) / spacing), (int3)(0), last);
    const float3 alpha = clamp((biased - grid_position(volume, base)) / spacing, 0.0f, 1.0f);

    // Which probes, and where.
    const int8 lane = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    const int8 step_x = lane & 1, step_y = (lane >> 1) & 1, step_z = lane >> 2;
    const int8 x = eight_cells(base.x, step_x, last.x), y = eight_cells(base.y, step_y, last.y),
               z = eight_cells(base.z, step_z, last.z);
    const int8 probes = (eight_scrolled(z, scroll_along(volume, 2), PROBES_Z) * PROBES_Y +
                         eight_scrolled(y, scroll_along(volume, 1), PROBES_Y)) * PROBES_X +
                        eight_scrolled(x, scroll_along(volume, 0), PROBES_X);
    int probe[8];
    vstore8(probes, 0, probe);
#define DATA(i) const float4 data##i = probe_data[probe[i]];
    EACH_OF_EIGHT(DATA)
#undef DATA
#define OFFSET_X(i) data##i.x
#define OFFSET_Y(i) data##i.y
#define OFFSET_Z(i) data##i.z
#define STATE(i) data##i.w
    const float8 at_x = origin.x + convert_float8(x) * spacing.x + (float8)OF_EIGHT(OFFSET_X);
    const float8 at_y = origin.y + convert_float8(y) * spacing.y + (float8)OF_EIGHT(OFFSET_Y);
    const float8 at_z = origin.z + convert_float8(z) * spacing.z + (float8)OF_EIGHT(OFFSET_Z);
    const float8 state = (float8)OF_EIGHT(STATE);
#undef OFFSET_X
#undef OFFSET_Y
#undef OFFSET_Z
#undef STATE

    const float8 to_x = at_x - position.x, to_y = at_y - position.y, to_z = at_z - position.z;
    const float8 facing = (to_x * normal.x + to_y * normal.y + to_z * normal.z) *
                              rsqrt(fmax(to_x * to_x + to_y * to_y + to_z * to_z, 1e-12f)) * 0.5f +
                          0.5f;
    float8 weight = facing * facing + 0.2f;

#if PROBE_VISIBILITY
    // The Chebyshev test.
    const float8 from_x = biased.x - at_x, from_y = biased.y - at_y, from_z = biased.z - at_z;
    const float8 meters =
        fmax(sqrt(from_x * from_x + from_y * from_y + from_z * from_z), 1e-6f);
    const float8 scale = 1.0f / fmax(fabs(from_x) + fabs(from_y) + fabs(from_z), 1e-30f);
    const float8 along_x = from_x * scale, along_y = from_y * scale;
    const float8 texel_x = eight_texels(along_x, along_y, from_z);
    const float8 texel_y = eight_texels(along_y, along_x, from_z);
    const float8 column = fmin(fmax(floor(texel_x), 0.0f), (float)DISTANCE_SIDE);
    const float8 row = fmin(fmax(floor(texel_y), 0.0f), (float)DISTANCE_SIDE);
    int nearest[8];
    float fraction_x[8], fraction_y[8];
    vstore8(convert_int8(row * (DISTANCE_SIDE + 2) + column), 0, nearest);
    vstore8(texel_x - column, 0, fraction_x);
    vstore8(texel_y - row, 0, fraction_y);
#define MOMENTS(i)                                                                       \
    const float2 moments##i =                                                            \
        distance_moments(distance_maps, (size_t)probe[i] * DISTANCE_MAP + nearest[i],    \
                         (float2)(fraction_x[i], fraction_y[i]));
    EACH_OF_EIGHT(MOMENTS)
#undef MOMENTS
#define MEAN(i) moments##i.x
#define MEAN_SQUARE(i) moments##i.y
    const float8 mean = (float8)OF_EIGHT(MEAN);
    const float8 variance = fabs(mean * mean - (float8)OF_EIGHT(MEAN_SQUARE));
#undef MEAN
#undef MEAN_SQUARE
    const float8 behind = meters * (1.0f / max_distance(volume)) - mean;
    const float8 seen = variance / (variance + behind * behind);
    weight *= behind > 0.0f ? fmax(seen * seen * seen, (float)(VISIBILITY_FLOOR)) : (float8)(1.0f);
#endif

    weight = fmax(weight, LEAST_WEIGHT);
    const float8 crushed =
        weight * weight * weight * (1.0f / (CRUSH_THRESHOLD * CRUSH_THRESHOLD));
    weight = weight < CRUSH_THRESHOLD ? crushed : weight;
    weight *= eight_trilinear(alpha.x, step_x) * eight_trilinear(alpha.y, step_y) *
              eight_trilinear(alpha.z, step_z);
    weight = state == (float)(PROBE_ACTIVE | PROBE_BLENDED) ? weight : (float8)(0.0f);

    float2 f;
    const int corner = map_corner(normal, IRRADIANCE_SIDE, &f);
    float each[8];
    vstore8(weight, 0, each);
    float4 sum = (float4)(0.0f);
    float weights = 0.0f;
    for (int i = 0; i < 8; ++i) {
        if (each[i] <= 0.0f) // What a probe holds that was never blended may be anything.
            continue;
        sum += each[i] * irradiance_term(irradiance_maps,
                                         (size_t)probe[i] * IRRADIANCE_MAP + corner, f);
        weights += each[i];
    }
    if (weights <= 0.0f)
        return (float3)(0.0f);
    return averaged(sum.xyz / weights) * (2.0f * PI_F * volume_weight(volume, position));
}

#else

// What a probe counts for a point of a surface, without its trilinear share: how far it is in front
// of the surface, and what the Chebyshev test leaves of it.
//   at        where the probe is, m
//   biased    the point a little off the surface, m
inline float probe_weight(__global const float *volume, MAP_PARAMS, int probe, float3 at,
                          float3 position, float3 biased, float3 normal)
{
    const float3 to_probe = at - position;
    const float facing =
        dot(to_probe, normal) * rsqrt(fmax(dot(to_probe, to_probe), 1e-12f)) * 0.5f + 0.5f;
    float weight = facing * facing + 0.2f;
#if PROBE_VISIBILITY
    const float3 from_probe = biased - at;
    const float meters = fmax(length(from_probe), 1e-6f);
    float2 g;
    const int nearest = map_corner(from_probe / meters, DISTANCE_SIDE, &g);
    const float2 moments =
        distance_moments(distance_maps, (size_t)probe * DISTANCE_MAP + nearest, g);
    const float behind = meters / max_distance(volume) - moments.x;
    if (behind > 0.0f) {
        // Chebyshev's inequality bounds how much of the surface the probe sees.
        const float variance = fabs(moments.x * moments.x - moments.y);
        const float seen = variance / (variance + behind * behind);
        weight *= fmax(VISIBILITY_FLOOR, seen * seen * seen);
    }
#endif
    weight = fmax(weight, LEAST_WEIGHT);
    if (weight < CRUSH_THRESHOLD)
        weight *= weight * weight * (1.0f / (CRUSH_THRESHOLD * CRUSH_THRESHOLD));
    return weight;
}

inline float3 gathered_irradiance(VOLUME_PARAMS, MAP_PARAMS, float3 position, float3 bias,
                                  float3 normal)
{
    const float3 spacing = load3(volume, 1);
    const int3 last = (int3)(PROBES_X - 1, PROBES_Y - 1, PROBES_Z - 1);
    const float3 biased = position + bias;
    const int3 base = clamp(convert_int3_rtn((biased - load3(volume, 0)) / spacing), (int3)(0), last);
    const float3 alpha = clamp((biased - grid_position(volume, base)) / spacing, 0.0f, 1.0f);
    float2 f;
    const int corner = map_corner(normal, IRRADIANCE_SIDE, &f);
    float4 sum = (float4)(0.0f);
    float weights = 0.0f;
    for (int i = 0; i < 8; ++i) {
        const int3 step = (int3)(i & 1, (i >> 1) & 1, i >> 2);
        const int3 cell = min(base + step, last);
        const int probe = probe_index(volume, cell);
        const float4 data = probe_data[probe];
        if ((int)data.w != (PROBE_ACTIVE | PROBE_BLENDED))
            continue;
        const float3 at = grid_position(volume, cell) + data.xyz;
        const float3 trilinear = fmax(mix(1.0f - alpha, alpha, convert_float3(step)), LEAST_TRILINEAR);
        float weight = probe_weight(volume, MAP_ARGS, probe, at, position, biased, normal);
        weight *= trilinear.x * trilinear.y * trilinear.z;

        sum += weight * irradiance_term(irradiance_maps, (size_t)probe * IRRADIANCE_MAP + corner, f);
        weights += weight;
    }
    if (weights <= 0.0f)
        return (float3)(0.0f);
    return averaged(sum.xyz / weights) * (2.0f * PI_F * volume_weight(volume, position));
}

#endif
#endif
