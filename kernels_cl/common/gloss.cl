// Roughness and metalness of surfaces (gibench/scene/gloss.py, which packs the images).
//
// Both are of the material, MATERIAL_ROUGHNESS and MATERIAL_METALNESS of its row, times the images where a
// triangle has one. GLOSS_MAPS=1, the build for scenes with such images of what reads them: its kernels
// take `gloss_maps`. Without, the material's numbers are all.
//
// gloss_maps (uint): for every triangle where its row begins, 0 for one without. A row is 9 words: the
// corners' coordinates (floats); first word, width and height of its image. A texel is a word: roughness
// (low) and metalness, each of 16 bits.
#ifndef GIBENCH_GLOSS
#define GIBENCH_GLOSS

#include "common/material.cl"

#if GLOSS_MAPS
#define GLOSS_PARAM , __global const uint *gloss_maps
#define GLOSS_ARG , gloss_maps

inline float2 gloss_texel(uint texel)
{
    return (float2)((float)(texel & 0xffffu), (float)(texel >> 16)) * (1.0f / 65535.0f);
}

// The image of `triangle` at weights u and v of its corners 1 and 2, bilinear with repeat; 1 without.
inline float2 gloss_image(__global const uint *gloss_maps, int triangle, float u, float v)
{
    const uint begin = gloss_maps[triangle];
    if (begin == 0)
        return (float2)(1.0f);
    __global const uint *row = gloss_maps + begin;
    __global const float *f = (__global const float *)row;
    const float w = 1.0f - u - v;
    const float s = w * f[0] + u * f[2] + v * f[4], t = w * f[1] + u * f[3] + v * f[5];
    const int width = (int)row[7], height = (int)row[8];
    const float x = (s - floor(s)) * width - 0.5f;
    const float y = (1.0f - (t - floor(t))) * height - 0.5f;
    const float x_floor = floor(x), y_floor = floor(y);
    const int left = wrapped((int)x_floor, width), right = wrapped((int)x_floor + 1, width);
    __global const uint *top = gloss_maps + row[6] + (size_t)wrapped((int)y_floor, height) * width;
    __global const uint *bottom =
        gloss_maps + row[6] + (size_t)wrapped((int)y_floor + 1, height) * width;
    return mix(mix(gloss_texel(top[left]), gloss_texel(top[right]), x - x_floor),
               mix(gloss_texel(bottom[left]), gloss_texel(bottom[right]), x - x_floor), y - y_floor);
}
#else
#define GLOSS_PARAM
#define GLOSS_ARG
#endif

// Perceptual roughness (x; alpha of a GGX distribution is its square) and metalness (y) at a hit.
inline float2 gloss_at(__global const int *material_ids, __global const float *materials GLOSS_PARAM,
                       Hit hit)
{
    __global const float *row = materials + MATERIAL_FLOATS * material_ids[hit.triangle];
    const float2 own = (float2)(row[MATERIAL_ROUGHNESS], row[MATERIAL_METALNESS]);
#if GLOSS_MAPS
    return own * gloss_image(gloss_maps, hit.triangle, hit.u, hit.v);
#else
    return own;
#endif
}

#endif
