// Direct light from point, spot and directional lights, with shadow rays.
//
// A light is LIGHT_FLOATS floats (macros: gibench.techniques.parts.macros), written by
// gibench.techniques.parts.light_table:
//   0      kind: LIGHT_DIRECTIONAL, LIGHT_POINT or LIGHT_SPOT
//   1-3    position (point, spot), m
//   4-6    unit direction the light travels along (directional, spot)
//   7-9    irradiance on a facing surface (directional), W/m2; intensity (point, spot), W/sr
//   10-11  scale and offset of the cone's fading (spot)
// A shadow ray ends at SHADOW_RAY_SHARE of its way.
#ifndef GIBENCH_LIGHTS
#define GIBENCH_LIGHTS

#include "common/vec.cl"
#include "common/bvh.cl"
#include "common/sampling.cl"

#define LIGHT_PARAMS __global const float *lights, int light_count
#define LIGHT_ARGS lights, light_count

typedef struct {
    float3 towards;    // unit, from the point to the light
    float distance;    // m; infinite for a directional light
    float3 irradiance; // on a surface that faces the light, unoccluded, W/m2
} LightSample;

inline LightSample light_at(__global const float *light, float3 position)
{
    LightSample s;
    const int kind = (int)light[0];
    const float3 power = (float3)(light[7], light[8], light[9]);
    const float3 along = (float3)(light[4], light[5], light[6]);
    if (kind == LIGHT_DIRECTIONAL) {
        s.towards = -along;
        s.distance = INFINITY;
        s.irradiance = power;
        return s;
    }
    const float3 to_light = (float3)(light[1], light[2], light[3]) - position;
    const float squared = fmax(dot(to_light, to_light), 1e-12f);
    s.distance = sqrt(squared);
    s.towards = to_light / s.distance;
    s.irradiance = power / squared;
    if (kind == LIGHT_SPOT) {
        // glTF, KHR_lights_punctual: "Inner and Outer Cone Angles".
        const float fade = clamp(-dot(s.towards, along) * light[10] + light[11], 0.0f, 1.0f);
        s.irradiance *= fade * fade;
    }
    return s;
}

// Irradiance of a light on a surface that nothing shadows, W/m2; light from behind the surface's
// geometric front does not count.
inline float3 unshadowed_irradiance(LightSample s, float3 normal, float3 geometric_normal)
{
    const float cosine = dot(normal, s.towards);
    if (cosine <= 0.0f || dot(geometric_normal, s.towards) <= 0.0f)
        return (float3)(0.0f);
    return s.irradiance * cosine;
}

// Irradiance of all lights at a point of a surface, W/m2.
//   position          on the surface, m
//   normal            unit shading normal
//   geometric_normal  unit normal of the surface's front; light from behind it does not count
inline float3 direct_irradiance(BVH_PARAMS, LIGHT_PARAMS, float3 position, float3 normal,
                                float3 geometric_normal)
{
    const float3 origin = offset_from_surface(position, geometric_normal);
    float3 sum = (float3)(0.0f);
    for (int i = 0; i < light_count; ++i) {
        const LightSample s = light_at(lights + i * LIGHT_FLOATS, position);
        const float3 gain = unshadowed_irradiance(s, normal, geometric_normal);
        if (gain.x + gain.y + gain.z <= 0.0f)
            continue;
        if (!bvh_occluded(BVH_ARGS, origin, s.towards, s.distance * SHADOW_RAY_SHARE))
            sum += gain;
    }
    return sum;
}

#endif
