// What a surface sends towards the eye, and what of it is diffuse: the one place where kernels say so.
// The path-traced truth has its own (reference/), so that the two can be held against each other.
#ifndef GIBENCH_SHADE
#define GIBENCH_SHADE

#include "common/vec.cl"

// The diffuse reflectance, 1/sr: every surface is Lambertian, which reflects alike to all sides.
inline float3 diffuse_reflectance(float3 albedo)
{
    return albedo * INV_PI_F;
}

// Radiance, W/m2/sr, of a surface that sends out `radiance` anyway (what it emits, or what other light
// has it reflect) and that `irradiance`, W/m2, falls on besides.
inline float3 with_reflected(float3 radiance, float3 albedo, float3 irradiance)
{
    return radiance + albedo * INV_PI_F * irradiance;
}

// The same where the reflectance is kept.
inline float3 with_diffuse(float3 radiance, float3 reflectance, float3 irradiance)
{
    return radiance + reflectance * irradiance;
}

// The same of a surface with gloss: `share` of what its lobe receives, `mirrored`, W/m2/sr, goes on to the
// eye; of the rest, what no metal takes is diffuse (Anonymous 2022, equation 4.2).
inline float3 with_gloss(float3 radiance, float3 albedo, float3 irradiance, float metalness, float3 share,
                         float3 mirrored)
{
    const float3 diffuse = albedo * (1.0f - metalness) * (1.0f - share);
    return with_reflected(radiance, diffuse, irradiance) + share * mirrored;
}

#endif
