// The hemisphere of a surfel as a texture of HEMISPHERE_SIDE x HEMISPHERE_SIDE texels, and the depth test on it.
//
// A direction's projection onto the tangent plane lies in the unit disk; Shirley and Chiu's 1997
// concentric map takes the disk to the square and keeps areas, so that under cosine-distributed
// rays all texels are equally likely.
// moments: MOMENT_FLOATS per surfel: mean distances of its texels, m, mean squared distances, and how many
// rays each texel has had.
#ifndef GIBENCH_GIBS_DEPTH
#define GIBENCH_GIBS_DEPTH

#include "common/vec.cl"

#define HEMISPHERE_TEXELS (HEMISPHERE_SIDE * HEMISPHERE_SIDE)
#define MOMENT_FLOATS (3 * HEMISPHERE_TEXELS)

// Square [-1, 1]^2 to the disk.
inline float2 disk_of_square(float2 s)
{
    if (s.x == 0.0f && s.y == 0.0f)
        return s;
    const bool wide = fabs(s.x) > fabs(s.y);
    const float r = wide ? s.x : s.y;
    const float ratio = wide ? s.y / s.x : s.x / s.y;
    const float angle = 0.25f * PI_F * ratio;
    return wide ? r * (float2)(cos(angle), sin(angle)) : r * (float2)(sin(angle), cos(angle));
}

// atan(x) * 4 / pi for x in [-1, 1], to 0.002 (Rajan et al. 2006, "Efficient Approximations for the
// Arctangent Function", equation 9).
inline float quarter_atan(float x)
{
    const float a = fabs(x);
    return x * (1.0f + (1.0f - a) * (0.2447f + 0.0663f * a) * (4.0f * INV_PI_F));
}

// The disk to the square [-1, 1]^2.
inline float2 square_of_disk(float2 d)
{
    const float r = length(d);
    const float2 a = fabs(d);
    if (r == 0.0f)
        return d;
    if (a.x > a.y)
        return copysign(r, d.x) * (float2)(1.0f, quarter_atan(d.y / d.x));
    return copysign(r, d.y) * (float2)(quarter_atan(d.x / d.y), 1.0f);
}

// The unit direction of a point of the square, around the normal.
inline float3 hemisphere_direction(float3 normal, float2 square)
{
    float3 tangent, bitangent;
    orthonormal_basis(normal, &tangent, &bitangent);
    const float2 d = disk_of_square(square);
    const float z = sqrt(fmax(1.0f - dot(d, d), 0.0f));
    return d.x * tangent + d.y * bitangent + z * normal;
}

// The point of the square of a unit direction; directions below the horizon go to its rim.
inline float2 hemisphere_square(float3 normal, float3 direction)
{
    float3 tangent, bitangent;
    orthonormal_basis(normal, &tangent, &bitangent);
    float2 d = (float2)(dot(direction, tangent), dot(direction, bitangent));
    const float size = length(d);
    if (dot(direction, normal) < 0.0f && size > 0.0f)
        d /= size;
    return square_of_disk(d);
}

inline int hemisphere_texel(float2 square)
{
    // Oclgrind 21.10 reads scalar bounds of a vector of integers as a vector.
    const int2 at = clamp(convert_int2((square + 1.0f) * (0.5f * HEMISPHERE_SIDE)), (int2)(0),
                          (int2)(HEMISPHERE_SIDE - 1));
    return at.y * HEMISPHERE_SIDE + at.x;
}

// How much of the point at surfel + offset the surfel is likely to see, in [0, 1]: 1 up to the mean
// distance in that direction, beyond it Chebyshev's bound (Donnelly and Lauritzen 2006, "Variance
// Shadow Maps"), cubed against leaks as DDGI does (RTXGI 1.3.7, irradiance gather). Moments are
// interpolated between texel centres.
inline float depth_visibility(__global const float *moments, uint id, float3 normal, float3 offset)
{
    const float distance = length(offset);
    if (distance <= 0.0f)
        return 1.0f;
    const float2 square = hemisphere_square(normal, offset / distance);
    const float2 at = clamp((square + 1.0f) * (0.5f * HEMISPHERE_SIDE) - 0.5f, 0.0f,
                            HEMISPHERE_SIDE - 1.0f);
    const int x0 = (int)at.x, y0 = (int)at.y;
    const int x1 = min(x0 + 1, HEMISPHERE_SIDE - 1), y1 = min(y0 + 1, HEMISPHERE_SIDE - 1);
    const float fx = at.x - x0, fy = at.y - y0;
    __global const float *m = moments + (size_t)id * MOMENT_FLOATS;
    float2 mean = (float2)(0.0f);
    for (int which = 0; which < 2; ++which) {
        __global const float *t = m + which * HEMISPHERE_TEXELS;
        const float top = mix(t[y0 * HEMISPHERE_SIDE + x0], t[y0 * HEMISPHERE_SIDE + x1], fx);
        const float low = mix(t[y1 * HEMISPHERE_SIDE + x0], t[y1 * HEMISPHERE_SIDE + x1], fx);
        if (which == 0)
            mean.x = mix(top, low, fy);
        else
            mean.y = mix(top, low, fy);
    }
    const float beyond = distance - mean.x;
    if (beyond <= 0.0f)
        return 1.0f;
    const float variance = fmax(mean.y - mean.x * mean.x, 0.0f);
    const float bound = variance / (variance + beyond * beyond);
    return bound * bound * bound;
}

#endif
