// A texel's moving average: what both variants of blending end with.
//
// Macros besides those of parts/probe_maps.cl: GAMMA, MAX_BACKFACES (rays on backs from which
// irradiance is not updated), and where averages are of encoded values (LINEAR 0)
// IRRADIANCE_THRESHOLD and BRIGHTNESS_THRESHOLD.
//
// frame_table  2 words: the frame's random number, and what of a texel stays (a float)
#ifndef GIBENCH_DDGI_TEXEL
#define GIBENCH_DDGI_TEXEL

#include "parts/probe_maps.cl"
#include "parts/probe_volume.cl"

inline float luminance(float3 c)
{
    return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z;
}

// Least sum of weights that is divided by.
#define LEAST_WEIGHTS (1e-9f * BLENDED)

// Half the mean radiance as the moving average takes it, of any number of channels.
#if LINEAR
#define sample_of(mean) (mean)
#else
#define sample_of(mean) powr(mean, 1.0f / GAMMA)
#endif

inline float3 texel_encoded(float3 mean)
{
#if DECODE_HALVES == 2
    return sqrt(mean);
#else
    return powr(mean, (float3)(1.0f / GAMMA));
#endif
}

inline float frame_kept(__global const uint *frame_table)
{
    return as_float(frame_table[1]);
}

// The new value of an irradiance texel and its coefficient of variation, both as stored.
//   sample    what this frame's rays say (sample_of)
//   previous  the texel's value; without meaning in a fresh probe
//   kept      what of it stays
// Of encoded values (RTXGI-DDGI 1.3.7, ProbeBlendingCS) a fall by more than IRRADIANCE_THRESHOLD
// takes 0.75 off the hysteresis, a rise in luminance by more than BRIGHTNESS_THRESHOLD counts a
// quarter: the average is too dark, the more the fewer rays bring the light, and the more so the
// brighter the unit of light. Of linear ones nothing is weighed by what it says.
inline float3 blend_irradiance_texel(float3 sample, float3 previous, bool fresh, float kept,
                                     float *variation)
{
    *variation = 0.0f;
#if LINEAR
    const float3 stored = texel_encoded(sample);
    if (fresh)
        return stored;
    const float3 root = decoded_root((float4)(previous, 0.0f)).xyz;
    const float3 before = root * root;
    const float3 result = texel_encoded(before + (1.0f - kept) * (sample - before));
#else
    const float3 stored = sample;
    if (fresh)
        return stored;
    float hysteresis = dot(previous, previous) == 0.0f ? 0.0f : kept;
    const float3 fall = previous - sample;
    if (fmax(fall.x, fmax(fall.y, fall.z)) > IRRADIANCE_THRESHOLD)
        hysteresis = fmax(0.0f, hysteresis - 0.75f);
    float3 change = sample - previous;
    if (luminance(change) > BRIGHTNESS_THRESHOLD)
        change *= 0.25f;
    const float3 result = previous + (1.0f - hysteresis) * change;
#endif
    const float3 variance = (stored - previous) * (stored - result);
    const float bright = luminance(result);
    if (bright > 1e-6f)
        *variation = luminance(sqrt(fmax(variance, 0.0f))) / bright;
    return result;
}

inline float2 blend_distance_texel(float2 sum, float weights, float2 previous, bool fresh,
                                   float kept)
{
    const float2 mean = sum / fmax(weights, LEAST_WEIGHTS);
    return fresh ? mean : mix(mean, previous, kept);
}

// Writes an irradiance texel and its variation, unless too many rays met backs.
inline void update_irradiance(int probe, int texel, float3 sample, float backs, bool fresh,
                              __global const uint *frame_table, __global map_t *irradiance_maps,
                              __global float *variability, __global int *accepted)
{
    const bool inside = backs >= MAX_BACKFACES;
    if (texel == 0)
        accepted[probe] = !inside;
    if (inside)
        return;
    const size_t at = map_texel(probe, texel, IRRADIANCE_SIDE);
    float variation;
    const float3 result = blend_irradiance_texel(sample, map_load4(at, irradiance_maps).xyz, fresh,
                                                 frame_kept(frame_table), &variation);
    const float4 stored = rounded4((float4)(result, 0.0f), frame_table[0] + (uint)at);
    map_store4(stored, at, irradiance_maps);
    variability[probe * IRRADIANCE_TEXELS + texel] = variation;
}

inline void update_distance(int probe, int texel, float2 sum, float weights, bool fresh,
                            __global const uint *frame_table, __global map_t *distance_maps)
{
    const size_t at = map_texel(probe, texel, DISTANCE_SIDE);
    const float2 result =
        blend_distance_texel(sum, weights, map_load2(at, distance_maps), fresh,
                             frame_kept(frame_table));
    const float4 stored = rounded4((float4)(result, 0.0f, 0.0f), ~frame_table[0] + (uint)at);
    map_store2(stored.xy, at, distance_maps);
}

#endif
