// Parts of triangles that are cut away by alpha masks (gibench/scene/cutouts.py, which packs them).
//
// CUTOUTS=1, the build for a scene that has any: every kernel that takes BVH_PARAMS takes `cutouts`
// too, and rays pass where a triangle is cut away. Without, nothing of this is compiled.
//
// cutouts (uint): for every triangle where its row begins, 0 for a whole one. A row is 9 words: the
// corners' coordinates (floats), first word, width and height of its image. An image has a bit for
// each texel, lowest first, rows from the top: 1 where there is surface.
#ifndef GIBENCH_CUTOUT
#define GIBENCH_CUTOUT

#if CUTOUTS
#define CUTOUT_PARAM , __global const uint *cutouts
#define CUTOUT_ARG , cutouts

// Whether `triangle` is cut away at barycentric weights u and v of its corners 1 and 2.
inline bool cut_away(__global const uint *cutouts, int triangle, float u, float v)
{
    const uint begin = cutouts[triangle];
    if (begin == 0)
        return false;
    __global const uint *row = cutouts + begin;
    const float w = 1.0f - u - v;
    const float x = w * as_float(row[0]) + u * as_float(row[2]) + v * as_float(row[4]);
    const float y = w * as_float(row[1]) + u * as_float(row[3]) + v * as_float(row[5]);
    const int width = (int)row[7], height = (int)row[8];
    const int column = min((int)((x - floor(x)) * width), width - 1);
    const int line = min((int)((1.0f - (y - floor(y))) * height), height - 1);
    const uint texel = (uint)line * (uint)width + (uint)column;
    return ((cutouts[row[6] + (texel >> 5)] >> (texel & 31u)) & 1u) == 0u;
}
#else
#define CUTOUT_PARAM
#define CUTOUT_ARG
#endif

#endif
