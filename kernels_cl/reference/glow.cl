// Triangles that emit by images, for the reference path tracer (gibench/reference/glow_pieces.py, which
// packs them).
//
// GLOW=1, the build for a scene that has any. Without, nothing of this is compiled.
//
// glow (uint): for every triangle where its row begins, 0 for one whose material says all. A row is 13
// words: the corners' coordinates (floats); first pixel, width and height of its image, whose pixels are
// three floats each; first word, width and height of the cells it is sampled by, which hold densities
// (floats, 1/m2); the density where it is the same everywhere (a float), else 0.
// emitter_pieces (emitters, 3, 2): what is sampled of each emitter's triangle, as weights of its corners
// 1 and 2.
#ifndef GIBENCH_REFERENCE_GLOW
#define GIBENCH_REFERENCE_GLOW
#include "reference/surface.cl"

#if GLOW
#define GLOW_PARAM , __global const uint *glow
#define GLOW_ARG , glow
#define PIECE_PARAM , __global const float *emitter_pieces
#define PIECE_ARG , emitter_pieces

// The weights of corners 1 and 2 of the triangle where a piece's own are u and v.
inline float2 in_piece(__global const float *emitter_pieces, int emitter, float u, float v)
{
    __global const float *p = emitter_pieces + 6 * (size_t)emitter;
    const float w = 1.0f - u - v;
    return (float2)(w * p[0] + u * p[2] + v * p[4], w * p[1] + u * p[3] + v * p[5]);
}

// What is emitted at weights u and v of corners 1 and 2, and the density of samples there; both are left
// as they are where no image says more.
inline void glow_at(__global const uint *glow, int triangle, float u, float v, float3 *emission,
                    float *density)
{
    const uint begin = glow[triangle];
    if (begin == 0)
        return;
    __global const uint *row = glow + begin;
    const float w = 1.0f - u - v;
    const float2 uv =
        (float2)(w * as_float(row[0]) + u * as_float(row[2]) + v * as_float(row[4]),
                 w * as_float(row[1]) + u * as_float(row[3]) + v * as_float(row[5]));
    *emission = texture_at((__global const float *)glow, (__global const int *)(row + 6), 0, uv);
    const int width = (int)row[10], height = (int)row[11];
    const int column = min((int)((uv.x - floor(uv.x)) * width), width - 1);
    const int line = min((int)((1.0f - (uv.y - floor(uv.y))) * height), height - 1);
    const float even = as_float(row[12]);
    *density = even > 0.0f ? even : as_float(glow[row[9] + (uint)(line * width + column)]);
}
#else
#define GLOW_PARAM
#define GLOW_ARG
#define PIECE_PARAM
#define PIECE_ARG
#endif

#endif
