// The probes' light where nothing is baked for: on what moves.
//
// Macros: PROBES; PROBE_RADIUS, m; LAMBDA_PROBE, LAMBDA_COEFFICIENT, LAMBDA_CHANNEL: how many floats
// apart two of them lie in lambda; SH_ORDER (0 to 2) of what is convolved; DEPTH_SIDE, texels of a depth
// map's side; LEAST_SEEN, the least share of a probe in reach; DEPTH_BIAS, m; VEC 1.
#ifndef GIBENCH_SRP_PROBE_LIGHT
#define GIBENCH_SRP_PROBE_LIGHT

#include "common/sh.cl"
#include "common/vec.cl"
#include "parts/octahedral_maps.cl"

// probe_position  (PROBES, 3), m
// probe_depth     (PROBES, DEPTH_SIDE + 2, DEPTH_SIDE + 2, 2) mean distance, m, and mean squared
//                 distance from a probe to what rests, octahedral with border
// lambda          the probes' SH coefficients, W/m2/sr
#define PROBE_LIGHT_PARAMS                                                       \
    __global const float *probe_position, __global const float *probe_depth, \
        __global const float *lambda
#define PROBE_LIGHT_ARGS probe_position, probe_depth, lambda

// w(t) = 2 t^3 - 3 t^2 + 1, by which receivers take probes, too (Bennett 2019, eq. 4.4).
inline float probe_weight(float distance)
{
    const float t = distance / PROBE_RADIUS;
    return t < 1.0f ? (2.0f * t - 3.0f) * t * t + 1.0f : 0.0f;
}

// Share of what lies at `distance` along a unit direction that a probe sees past what rests: the
// Chebyshev bound, cubed (Majercik et al. 2019, section 4.4, after Donnelly and Lauritzen 2006).
inline float probe_sees(__global const float *probe_depth, int probe, float3 direction,
                        float distance)
{
    float2 f;
    const int corner = map_corner(direction, DEPTH_SIDE, &f);
    __global const float *map = probe_depth + 2 * (size_t)MAP_TEXELS(DEPTH_SIDE) * probe;
    const float2 top = mix(vload2(corner, map), vload2(corner + 1, map), f.x);
    const float2 bottom = mix(vload2(corner + DEPTH_SIDE + 2, map),
                              vload2(corner + DEPTH_SIDE + 3, map), f.x);
    const float2 moments = mix(top, bottom, f.y);
    const float behind = distance - DEPTH_BIAS - moments.x;
    if (behind <= 0.0f)
        return 1.0f;
    const float variance = fabs(moments.y - moments.x * moments.x);
    const float bound = variance / (variance + behind * behind);
    return fmax(bound * bound * bound, LEAST_SEEN);
}

// Irradiance, W/m2, that a probe's radiance makes on a surface of a normal whose convolved basis is
// `basis` (Ramamoorthi and Hanrahan 2001); nothing negative.
inline float3 probe_irradiance(__global const float *lambda, int probe, const float *basis)
{
    __global const float *own = lambda + (size_t)LAMBDA_PROBE * probe;
    float3 sum = (float3)(0.0f);
    for (int j = 0; j < SH_COUNT; ++j) {
        __global const float *c = own + LAMBDA_COEFFICIENT * j;
        sum += basis[j] * (float3)(c[0], c[LAMBDA_CHANNEL], c[2 * LAMBDA_CHANNEL]);
    }
    return fmax(sum, (float3)(0.0f));
}

// The cosine's convolution over a hemisphere: pi, 2 pi / 3, pi / 4 by band.
inline void convolved_basis(float3 normal, float *basis)
{
    for (int j = 0; j < SH_COUNT; ++j)
        basis[j] = 0.0f;
    sh_accumulate(normal.x, normal.y, normal.z, 1.0f, basis);
    for (int j = 0; j < SH_COUNT; ++j)
        basis[j] *= j < 1 ? PI_F : j < 4 ? 2.0f * PI_F / 3.0f : PI_F / 4.0f;
}

// Irradiance, W/m2, at a point: the probes in reach, weighed by distance and by what they see; where
// none is in reach, the nearest.
inline float3 probe_light(PROBE_LIGHT_PARAMS, float3 position, float3 normal)
{
    float basis[SH_COUNT];
    convolved_basis(normal, basis);
    float3 sum = (float3)(0.0f);
    float total = 0.0f, least = INFINITY;
    int nearest = 0;
    for (int probe = 0; probe < PROBES; ++probe) {
        const float3 towards = position - load3(probe_position, probe);
        const float squared = dot(towards, towards);
        if (squared < least) {
            least = squared;
            nearest = probe;
        }
        const float distance = sqrt(squared);
        float weight = probe_weight(distance);
        if (weight <= 0.0f)
            continue;
        if (distance > 0.0f)
            weight *= probe_sees(probe_depth, probe, towards / distance, distance);
        sum += weight * probe_irradiance(lambda, probe, basis);
        total += weight;
    }
    return total > 0.0f ? sum / total : probe_irradiance(lambda, nearest, basis);
}

#endif
