// Glossy reflection: the terms of Cook and Torrance 1982 with the distribution of Trowbridge and Reitz
// 1975 (called GGX; Walter et al. 2007), Schlick's shadowing (Schlick 1994; k = alpha / 2 as Karis 2013
// has it for light from all around) and Schlick's Fresnel term; and Karis's split sum: what a surface reflects
// of light that is alike within its lobe.
//
// Macros (gibench.techniques.parts.split_sum): SPLIT_SUM_SIDE, entries of the table's side; LEAST_ALPHA, of
// the smoothest surface; DIELECTRIC_F0, what one that is no metal reflects of light that falls on it straight.
//
// Roughness is perceptual, 0 to 1: alpha is its square (Burley 2012). Directions are unit and point away
// from the surface.
#ifndef GIBENCH_GGX
#define GIBENCH_GGX

#include "common/vec.cl"

inline float ggx_alpha(float roughness)
{
    return fmax(roughness * roughness, LEAST_ALPHA);
}

// How many of the facets face along h, 1/sr; `off` is 1 - (n . h)^2, which keeps the digits that
// (n . h)^2 loses close to 1.
inline float ggx_distribution(float off, float alpha)
{
    const float squared = alpha * alpha;
    const float width = off + squared * (1.0f - off);
    return squared / (PI_F * width * width);
}

// What of the facets that face rightly neither side hides.
inline float smith_schlick(float n_v, float n_l, float alpha)
{
    const float k = 0.5f * alpha;
    return n_v / (n_v * (1.0f - k) + k) * (n_l / (n_l * (1.0f - k) + k));
}

inline float3 fresnel_schlick(float3 f0, float v_h)
{
    const float away = clamp(1.0f - v_h, 0.0f, 1.0f);
    const float squared = away * away;
    return f0 + (1.0f - f0) * (squared * squared * away);
}

// What a material reflects of light that falls on it straight.
inline float3 straight_reflectance(float3 base_color, float metalness)
{
    return mix((float3)(DIELECTRIC_F0), base_color, metalness);
}

// The glossy reflectance, 1/sr, of light from `l` towards `v`.
inline float3 glossy_reflectance(float3 n, float3 v, float3 l, float alpha, float3 f0)
{
    const float n_v = dot(n, v), n_l = dot(n, l);
    if (n_v <= 0.0f || n_l <= 0.0f)
        return (float3)(0.0f);
    const float3 h = normalize(v + l), across = cross(n, h);
    const float facets = ggx_distribution(dot(across, across), alpha) * smith_schlick(n_v, n_l, alpha);
    return fresnel_schlick(f0, dot(v, h)) * (facets / (4.0f * n_v * n_l));
}

// What of light that is alike within the lobe goes on to the eye: the table's bilinear value.
//   split_sum  (SPLIT_SUM_SIDE, SPLIT_SUM_SIDE) of 2: rows roughness, columns n . v
inline float3 glossy_share(__global const float *split_sum, float3 f0, float n_v, float roughness)
{
    const float2 at = clamp((float2)(n_v, roughness) * SPLIT_SUM_SIDE - 0.5f, (float2)(0.0f),
                            (float2)(SPLIT_SUM_SIDE - 1));
    // Both operands vectors: Oclgrind 21.10 takes the least of the first component alone otherwise.
    const int2 first = min(convert_int2(at), (int2)(SPLIT_SUM_SIDE - 2));
    const float2 f = at - convert_float2(first);
    const int corner = first.y * SPLIT_SUM_SIDE + first.x;
    const float2 upper = mix(vload2(corner, split_sum), vload2(corner + 1, split_sum), f.x);
    const float2 lower = mix(vload2(corner + SPLIT_SUM_SIDE, split_sum),
                             vload2(corner + SPLIT_SUM_SIDE + 1, split_sum), f.x);
    const float2 both = mix(upper, lower, f.y);
    return f0 * both.x + both.y;
}

#endif
