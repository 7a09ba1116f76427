// Light of order 1 at the receivers on what the camera sees: irradiance at the normal that a surface is
// shaded with, its normal map's where it has one, and glossy reflection.
//
// At a receiver lie irradiance at its own normal and the gradient of irradiance in the normal, a colour
// for each axis (gibench/techniques/srp/bake/data.py). Between receivers they are blended as they are;
// the receivers' own normals, were they blended, would be the interpolated normal.
// Macros: NORMAL_MAPS; GLOSS and, with it, GLOSS_MAPS, SPLIT_SUM_SIDE.
#include "common/lightmap.cl"
#include "common/material.cl"
#include "common/normal_map.cl"
#include "common/shade.cl"

#if GLOSS
#include "common/ggx.cl"
#include "common/gloss.cl"
#define REFLECTED 1
#define MATERIAL_PARAM , __global const int *material_ids, __global const float *materials GLOSS_PARAM
#define MATERIAL_ARG , material_ids, materials GLOSS_ARG
#else
#define MATERIAL_PARAM
#define MATERIAL_ARG
#endif

#define LOOKUP_PARAMS LIGHTMAP_PARAMS, SHAPE_PARAMS NORMAL_MAP_PARAM MATERIAL_PARAM
#define LOOKUP_ARGS LIGHTMAP_ARGS, SHAPE_ARGS NORMAL_MAP_ARG MATERIAL_ARG

// Irradiance, W/m2, at a normal that lies `bent` off the receiver's: order 1 may fall below 0 where it
// is dark.
inline float3 irradiance_at(const float3 *signal, float3 bent)
{
    return max(signal[0] + bent.x * signal[1] + bent.y * signal[2] + bent.z * signal[3], 0.0f);
}

// The normal that a surface is shaded with.
inline float3 shading_normal(LOOKUP_PARAMS, Hit hit, Surface s)
{
#if NORMAL_MAPS
    return mapped_normal(normal_maps, hit.triangle, hit.u, hit.v, s.normal, s.geometric_normal);
#else
    return s.normal;
#endif
}

#if GLOSS
// Rec. 709.
#define LUMINANCE ((float3)(0.2126f, 0.7152f, 0.0722f))

// Radiance, W/m2/sr, that goes towards `v` by glossy reflection: the linear terms are taken for one
// light from afar (Silvennoinen and Lehtinen 2017, section 5.1; Sloan 2008, "Stupid Spherical Harmonics
// Tricks"), which lies along the gradient of luminance and whose irradiance, on what faces it, is twice
// the gradient that way.
inline float3 glossy(const float3 *signal, float3 n, float3 v, float2 gloss, float3 albedo)
{
    const float3 slope = (float3)(dot(LUMINANCE, signal[1]), dot(LUMINANCE, signal[2]),
                                  dot(LUMINANCE, signal[3]));
    const float steepness = length(slope);
    if (!(steepness > 0.0f))
        return (float3)(0.0f);
    const float3 l = slope * (1.0f / steepness);
    const float3 power = max(2.0f * (l.x * signal[1] + l.y * signal[2] + l.z * signal[3]), 0.0f);
    const float3 f0 = straight_reflectance(albedo, gloss.y);
    return glossy_reflectance(n, v, l, ggx_alpha(gloss.x), f0) * (fmax(dot(n, l), 0.0f) * power);
}

// Diffuse, but of metal, and glossy.
inline float3 reflected(LOOKUP_PARAMS, Hit hit, float3 direction, float3 albedo)
{
    float3 signal[COMPONENTS];
    lightmap_signal(LIGHTMAP_ARGS, hit, signal);
    const Surface s = surface_shape(SHAPE_ARGS, hit);
    const float3 n = shading_normal(LOOKUP_ARGS, hit, s);
    const float2 gloss = gloss_at(material_ids, materials GLOSS_ARG, hit);
    const float3 diffuse = with_reflected((float3)(0.0f), albedo * (1.0f - gloss.y),
                                          irradiance_at(signal, n - s.normal));
    return diffuse + glossy(signal, n, -direction, gloss, albedo);
}
#else
inline float3 looked_up(LOOKUP_PARAMS, Hit hit, float3 direction)
{
#if NORMAL_MAPS
    if (normal_maps[hit.triangle] == 0)
        return lightmap_irradiance(LIGHTMAP_ARGS, hit);
#endif
    float3 signal[COMPONENTS];
    lightmap_signal(LIGHTMAP_ARGS, hit, signal);
    const Surface s = surface_shape(SHAPE_ARGS, hit);
    return irradiance_at(signal, shading_normal(LOOKUP_ARGS, hit, s) - s.normal);
}
#endif
#include "parts/apply.cl"
