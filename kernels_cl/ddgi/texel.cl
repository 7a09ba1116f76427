// A texel's moving average: what both variants of blending end with.
//
// Macros besides those of parts/probe_gather.cl: HYSTERESIS, GAMMA, IRRADIANCE_THRESHOLD,
// BRIGHTNESS_THRESHOLD, MAX_BACKFACES (rays on backs from which irradiance is not updated).
#ifndef GIBENCH_DDGI_TEXEL
#define GIBENCH_DDGI_TEXEL

#include "parts/probe_gather.cl"

inline float luminance(float3 c)
{
    return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z;
}

// Least sum of weights that is divided by.
#define LEAST_WEIGHTS (1e-9f * BLENDED)

// The new value of an irradiance texel and its coefficient of variation.
//   sample    what this frame's rays say, encoded
//   previous  the texel's value; without meaning in a fresh probe
// RTXGI-DDGI 1.3.7, ProbeBlendingCS: a fall by more than IRRADIANCE_THRESHOLD takes 0.75 off the
// hysteresis, a rise in luminance by more than BRIGHTNESS_THRESHOLD counts a quarter.
inline float3 blend_irradiance_texel(float3 sample, float3 previous, bool fresh, float *variation)
{
    *variation = 0.0f;
    if (fresh)
        return sample;
    float hysteresis = dot(previous, previous) == 0.0f ? 0.0f : HYSTERESIS;
    const float3 fall = previous - sample;
    if (fmax(fall.x, fmax(fall.y, fall.z)) > IRRADIANCE_THRESHOLD)
        hysteresis = fmax(0.0f, hysteresis - 0.75f);
    float3 change = sample - previous;
    if (luminance(change) > BRIGHTNESS_THRESHOLD)
        change *= 0.25f;
    const float3 result = previous + (1.0f - hysteresis) * change;
    const float3 variance = (sample - previous) * (sample - result);
    const float bright = luminance(result);
    if (bright > 1e-6f)
        *variation = luminance(sqrt(fmax(variance, 0.0f))) / bright;
    return result;
}

inline float2 blend_distance_texel(float2 sum, float weights, float2 previous, bool fresh)
{
    const float2 mean = sum / fmax(weights, LEAST_WEIGHTS);
    return fresh ? mean : mix(mean, previous, HYSTERESIS);
}

// Writes an irradiance texel and its variation, unless too many rays met backs.
inline void update_irradiance(int probe, int texel, float3 sample, float backs, bool fresh, uint key,
                              __global map_t *irradiance_maps, __global float *variability,
                              __global int *accepted)
{
    const bool inside = backs >= MAX_BACKFACES;
    if (texel == 0)
        accepted[probe] = !inside;
    if (inside)
        return;
    const size_t at = map_texel(probe, texel, IRRADIANCE_SIDE);
    float variation;
    const float3 result = blend_irradiance_texel(sample, map_load4(at, irradiance_maps).xyz, fresh,
                                                 &variation);
    const float4 stored = rounded4((float4)(result, 0.0f), key + (uint)at);
    map_store4(stored, at, irradiance_maps);
    variability[probe * IRRADIANCE_TEXELS + texel] = variation;
}

inline void update_distance(int probe, int texel, float2 sum, float weights, bool fresh, uint key,
                            __global map_t *distance_maps)
{
    const size_t at = map_texel(probe, texel, DISTANCE_SIDE);
    const float2 result =
        blend_distance_texel(sum, weights, map_load2(at, distance_maps), fresh);
    const float4 stored = rounded4((float4)(result, 0.0f, 0.0f), ~key + (uint)at);
    map_store2(stored.xy, at, distance_maps);
}

#endif
