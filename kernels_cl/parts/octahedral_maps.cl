// Octahedral maps: a square of texels that holds a value for every direction (Cigolle et al. 2014,
// "A Survey of Efficient Representations for Independent Unit Vectors"), one per probe, each with a
// border of one texel (parts/border_copy.cl), so that bilinear lookups need no special case.
//
// A map of `side` texels has (side + 2)^2 with its border, rows upwards. Macro: HALF_MAPS, whether
// values are kept in 16 bits.
#ifndef GIBENCH_OCTAHEDRAL_MAPS
#define GIBENCH_OCTAHEDRAL_MAPS

#include "common/octahedral.cl"
#include "common/random.cl"
#include "common/vec.cl"

// Texels of a map with its border.
#define MAP_TEXELS(side) (((side) + 2) * ((side) + 2))

#if HALF_MAPS
typedef half map_t;
#define map_load4(i, p) vload_half4(i, p)
#define map_load2(i, p) vload_half2(i, p)
#define map_store4(v, i, p) vstore_half4(v, i, p)
#define map_store2(v, i, p) vstore_half2(v, i, p)
#else
typedef float map_t;
#define map_load4(i, p) vload4(i, p)
#define map_load2(i, p) vload2(i, p)
#define map_store4(v, i, p) vstore4(v, i, p)
#define map_store2(v, i, p) vstore2(v, i, p)
#endif

// Texel `texel` (row by row, without border) of a probe's map: its place among all maps' texels.
inline size_t map_texel(int probe, int texel, int side)
{
    const int across = side + 2;
    const int row = texel / side, column = texel % side;
    return (size_t)probe * across * across + (row + 1) * across + column + 1;
}

// The direction at the centre of a texel.
inline float3 texel_direction(int texel, int side)
{
    const float2 at = (float2)(texel % side + 0.5f, texel / side + 0.5f);
    return octahedral_decode(at * (2.0f / side) - 1.0f);
}

// Bilinear weights and upper left texel (border counted) of a direction in a map.
inline int map_corner(float3 direction, int side, float2 *fraction)
{
    const float2 at = (octahedral_encode(direction) * 0.5f + 0.5f) * side + 0.5f;
    const float2 corner = clamp(floor(at), 0.0f, (float)side);
    *fraction = at - corner;
    return (int)corner.y * (side + 2) + (int)corner.x;
}

#if HALF_MAPS
// Values >= 0 rounded to what fp16 holds, up or down at random so that the mean stays: a moving
// average moves by less than fp16's step and would stand still if it were rounded to the nearest.
inline float4 rounded4(float4 v, uint key)
{
    const uint a = random_bits(key), b = random_bits(a);
    const uint4 bits = as_uint4(v) + ((uint4)(a, a >> 16, b, b >> 16) & 0x1fffu);
    return as_float4(bits & ~0x1fffu);
}
#else
#define rounded4(v, key) (v)
#endif

#endif
