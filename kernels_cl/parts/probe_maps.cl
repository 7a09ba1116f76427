// A volume's maps: what a texel of irradiance stands for, and how many there are.
//
// Macros besides those of parts/octahedral_maps.cl: IRRADIANCE_SIDE and DISTANCE_SIDE (texels of a
// map's side without its border); DECODE_HALVES (gamma where it is a whole number, else 0) and DECODE
// (gamma / 2). With PROBE_VISIBILITY 0 there is no Chebyshev test and no distance map.
//
// irradiance_maps  per probe (side + 2)^2 texels of 4: (half the mean incoming radiance, weighed by
//                  the cosine)^(1/gamma), rows upwards; the fourth is not used
// distance_maps    per probe (side + 2)^2 texels of 2: mean and mean square of the distance, in
//                  units of max_distance, so that fp16 holds them in scenes of any size
#ifndef GIBENCH_PROBE_MAPS
#define GIBENCH_PROBE_MAPS

#include "parts/octahedral_maps.cl"

// LINEAR 1: texels and probes are averaged as what they stand for. 0: texels as they are stored, probes as
// square roots (RTXGI-DDGI 1.3.7), which is darker where they differ.

#define IRRADIANCE_TEXELS (IRRADIANCE_SIDE * IRRADIANCE_SIDE)
#define IRRADIANCE_MAP MAP_TEXELS(IRRADIANCE_SIDE)
#if PROBE_VISIBILITY
#define DISTANCE_TEXELS (DISTANCE_SIDE * DISTANCE_SIDE)
#define DISTANCE_MAP MAP_TEXELS(DISTANCE_SIDE)
#endif

// Stored irradiance to the square root of what it stands for.
inline float4 decoded_root(float4 stored)
{
#if DECODE_HALVES
    float4 value = DECODE_HALVES % 2 ? sqrt(stored) : (float4)(1.0f);
    for (int i = 0; i < DECODE_HALVES / 2; ++i)
        value *= stored;
    return value;
#else
    return powr(stored, (float4)(DECODE));
#endif
}

#endif
