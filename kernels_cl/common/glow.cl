// Triangles that emit by images (gibench/scene/glow.py, which packs them).
//
// GLOW=1, the build for a scene that has any: every kernel that takes SURFACE_PARAMS takes `glow` too.
// Without, nothing of this is compiled.
//
// glow (uint): for every triangle where its row begins, 0 for one whose material says all. A row is 10
// words: the corners' coordinates (floats); first word, width and height of its image; what decoded
// texels are multiplied with (a float). A texel is a word: red, green and blue of 9 bits each, lowest
// first, and an exponent of 5 (EXT_texture_shared_exponent).
#ifndef GIBENCH_GLOW
#define GIBENCH_GLOW

#if GLOW
#define GLOW_PARAM , __global const uint *glow
#define GLOW_ARG , glow

inline float3 glow_texel(uint texel)
{
    const float3 codes =
        (float3)((float)(texel & 511u), (float)((texel >> 9) & 511u), (float)((texel >> 18) & 511u));
    // 2^(exponent - 24) by its bits.
    return codes * as_float(((texel >> 27) + 103u) << 23);
}

inline int glow_wrapped(int i, int n)
{
    const int r = i % n;
    return r < 0 ? r + n : r;
}

// What `triangle` emits at weights u and v of its corners 1 and 2, W/m2/sr: its image's value there,
// bilinear with repeat, row 0 at v = 1; `otherwise` where it has none.
inline float3 glow_at(__global const uint *glow, int triangle, float u, float v, float3 otherwise)
{
    const uint begin = glow[triangle];
    if (begin == 0)
        return otherwise;
    __global const uint *row = glow + begin;
    const float w = 1.0f - u - v;
    const float s = w * as_float(row[0]) + u * as_float(row[2]) + v * as_float(row[4]);
    const float t = w * as_float(row[1]) + u * as_float(row[3]) + v * as_float(row[5]);
    const int width = (int)row[7], height = (int)row[8];
    const float x = (s - floor(s)) * width - 0.5f;
    const float y = (1.0f - (t - floor(t))) * height - 0.5f;
    const float x_floor = floor(x), y_floor = floor(y);
    const int left = glow_wrapped((int)x_floor, width), right = glow_wrapped((int)x_floor + 1, width);
    __global const uint *top = glow + row[6] + (size_t)glow_wrapped((int)y_floor, height) * width;
    __global const uint *bottom =
        glow + row[6] + (size_t)glow_wrapped((int)y_floor + 1, height) * width;
    const float3 found =
        mix(mix(glow_texel(top[left]), glow_texel(top[right]), x - x_floor),
            mix(glow_texel(bottom[left]), glow_texel(bottom[right]), x - x_floor), y - y_floor);
    return found * as_float(row[9]);
}
#else
#define GLOW_PARAM
#define GLOW_ARG
#endif

#endif
