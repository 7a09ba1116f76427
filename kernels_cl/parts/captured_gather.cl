// The light that captured probes hold, at a surface.
//
// Irradiance, W/m2: trilinear between the probes around a point; with PROBE_VISIBILITY times the cubed
// Chebyshev bound on how much of the point a probe sees (Donnelly and Lauritzen 2006; McGuire et al.
// 2017). Weights are divided by their sum, so that where no probe sees a point those that see it least
// badly light it.
//
// Macros besides those of parts/probe_volume.cl and parts/octahedral_maps.cl: SIDE (texels of a map's
// side without its border), PROBE_VISIBILITY, EVERY_PROBE (1: every probe is looked at, as published; 0:
// the eight around the point, which are all that have a share). Lengths behind the volume: how far off
// its surface a point is looked at, m; what is taken off its distance, in units of the next; the far
// plane's distance, m, the unit of distances.
//
// irradiance_maps  per probe (SIDE + 2)^2 texels of 4: irradiance, W/m2; the fourth is not used
// distance_maps    per probe (SIDE + 2)^2 texels of 2: mean and mean square of the distance
//
// LOBE_STEPS, where it is not 0: the light that comes from where the surface mirrors is looked up with it
// (parts/captured_lobes.cl); BOX_LOW and BOX_HIGH with _X, _Y and _Z are then the scene's box, m.
#ifndef GIBENCH_CAPTURED_GATHER
#define GIBENCH_CAPTURED_GATHER

#include "parts/octahedral_maps.cl"
#include "parts/probe_volume.cl"
#if LOBE_STEPS
#include "parts/captured_lobes.cl"
#endif

#if PROBE_VISIBILITY
#define MAP_PARAMS __global const map_t *irradiance_maps, __global const map_t *distance_maps
#define MAP_ARGS irradiance_maps, distance_maps
#else
#define MAP_PARAMS __global const map_t *irradiance_maps
#define MAP_ARGS irradiance_maps
#endif

// Bilinear value of a map of `side` texels, from its upper left texel on.
inline float3 held_light(__global const map_t *maps, size_t first, int side, float2 fraction)
{
    const size_t below = first + side + 2;
    const float4 upper = mix(map_load4(first, maps), map_load4(first + 1, maps), fraction.x);
    const float4 lower = mix(map_load4(below, maps), map_load4(below + 1, maps), fraction.x);
    return mix(upper, lower, fraction.y).xyz;
}

#if LOBE_STEPS
#define LOBE_PARAM , __global const map_t *lobe_maps, float3 mirrored, float roughness, float3 *received
#else
#define LOBE_PARAM
#endif

#if LOBE_STEPS
// Where the ray from a point, m, leaves the scene's box: what is mirrored is taken to be there
// (Lagarde and Zanuttini 2012).
inline float3 leaves_box(float3 point, float3 direction)
{
    const float3 low = (float3)(BOX_LOW_X, BOX_LOW_Y, BOX_LOW_Z);
    const float3 high = (float3)(BOX_HIGH_X, BOX_HIGH_Y, BOX_HIGH_Z);
    const float3 wall = (float3)(direction.x > 0.0f ? high.x : low.x, direction.y > 0.0f ? high.y : low.y,
                                 direction.z > 0.0f ? high.z : low.z);
    const float3 slow = fmax(fabs(direction), 1e-9f);
    const float3 way = fmax(copysign((float3)(1.0f), direction) * (wall - point), 0.0f) / slow;
    return point + fmin(way.x, fmin(way.y, way.z)) * direction;
}

// Radiance of a probe's map of a step, W/m2/sr.
inline float3 lobe_radiance(__global const map_t *lobe_maps, int probe, int step, float3 direction)
{
    const int side = lobe_side(step);
    float2 f;
    const int corner = map_corner(direction, side, &f);
    return held_light(lobe_maps, lobe_first(step) + (size_t)probe * MAP_TEXELS(side) + corner, side, f);
}

// Radiance, W/m2/sr, that a lobe of `roughness` about `direction`, not 0, receives from a probe.
inline float3 received_light(__global const map_t *lobe_maps, int probe, float3 direction, float roughness)
{
    const float step = clamp(roughness, 0.0f, 1.0f) * (LOBE_STEPS - 1);
    const int lower = min((int)step, LOBE_STEPS - 2);
    const float3 d = normalize(direction);
    return mix(lobe_radiance(lobe_maps, probe, lower, d), lobe_radiance(lobe_maps, probe, lower + 1, d),
               step - lower);
}
#endif

#if PROBE_VISIBILITY
// The bound, cubed, on how much a probe sees of what lies `offset`, m, from it.
inline float seen_share(__global const float *volume, __global const map_t *distance_maps, int probe,
                        float3 offset)
{
    const float meters = fmax(length(offset), 1e-9f);
    float2 f;
    const int corner = map_corner(offset / meters, SIDE, &f);
    const size_t first = (size_t)probe * MAP_TEXELS(SIDE) + corner, below = first + SIDE + 2;
    const float2 upper = mix(map_load2(first, distance_maps), map_load2(first + 1, distance_maps), f.x);
    const float2 lower = mix(map_load2(below, distance_maps), map_load2(below + 1, distance_maps), f.x);
    const float2 moments = mix(upper, lower, f.y);
    const float behind = meters / volume_length(volume, 2) - volume_length(volume, 1) - moments.x;
    if (behind <= 0.0f)
        return 1.0f;
    const float variance = fabs(moments.x * moments.x - moments.y);
    const float share = variance / fmax(variance + behind * behind, 1e-30f);
    return share * share * share;
}
#endif

// What the probe at grid coordinates `cell` counts for a point.
//   point  m
//   at     the same in grid coordinates
inline float probe_share(VOLUME_PARAMS, MAP_PARAMS, int probe, int3 cell, float3 at, float3 point)
{
    const float3 near = fmax(1.0f - fabs(convert_float3(cell) - at), 0.0f);
    float share = near.x * near.y * near.z;
    if (share <= 0.0f || probe_state(probe_data, probe) != (PROBE_ACTIVE | PROBE_BLENDED))
        return 0.0f;
#if PROBE_VISIBILITY
    share *= seen_share(volume, distance_maps, probe, point - grid_position(volume, cell));
#endif
    return share;
}

// Irradiance at a surface, W/m2. With LOBE_STEPS also, in `received`, radiance from where a surface of
// `roughness` mirrors along unit `mirrored`, averaged over its lobe, W/m2/sr.
inline float3 probe_irradiance(VOLUME_PARAMS, MAP_PARAMS LOBE_PARAM, float3 position,
                               float3 geometric_normal, float3 normal)
{
    const float3 point = position + volume_length(volume, 0) * geometric_normal;
    const float3 at = (point - load3(volume, 0)) / load3(volume, 1);
    const int3 last = (int3)(PROBES_X - 1, PROBES_Y - 1, PROBES_Z - 1);
    float2 f;
    const int corner = map_corner(normal, SIDE, &f);
    float3 sum = (float3)(0.0f);
    float shares = 0.0f;
#if LOBE_STEPS
    const float3 place = leaves_box(position, mirrored);
    *received = (float3)(0.0f);
#endif
#if EVERY_PROBE
    for (int i = 0; i < PROBES; ++i) {
        const int3 cell = (int3)(i % PROBES_X, i / PROBES_X % PROBES_Y, i / (PROBES_X * PROBES_Y));
#else
    const int3 base = clamp(convert_int3_rtn(at), (int3)(0), last);
    for (int i = 0; i < 8; ++i) {
        const int3 cell = base + (int3)(i & 1, (i >> 1) & 1, i >> 2);
        if (any(cell > last))
            continue;
#endif
        const int probe = probe_index(volume, cell);
        const float share = probe_share(VOLUME_ARGS, MAP_ARGS, probe, cell, at, point);
        if (share <= 0.0f)
            continue;
        sum += share * held_light(irradiance_maps, (size_t)probe * MAP_TEXELS(SIDE) + corner, SIDE, f);
        shares += share;
#if LOBE_STEPS
        const float3 towards = place - probe_position(VOLUME_ARGS, probe);
        *received += share * received_light(lobe_maps, probe, towards, roughness);
#endif
    }
#if LOBE_STEPS
    if (shares > 0.0f)
        *received /= shares;
#endif
    return shares > 0.0f ? sum / shares : (float3)(0.0f);
}

#endif
