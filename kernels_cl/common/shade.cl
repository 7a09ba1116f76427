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

#endif
