// Normal maps (gibench/scene/normal_maps.py, which packs them).
//
// NORMAL_MAPS=1, the build of what reads them: its kernels take `normal_maps`. Without, nothing of this
// is compiled.
//
// normal_maps (uint): for every triangle where its row begins, 0 for one without. A row is 22 words: the
// corners' coordinates (floats); first word, width and height of its image; the scale of x and y; for
// each corner its tangent and the bitangent's sign (floats). A texel is a word: x and y of a unit vector,
// signed numbers of 16 bits.
#ifndef GIBENCH_NORMAL_MAP
#define GIBENCH_NORMAL_MAP

#if NORMAL_MAPS
#define NORMAL_MAP_PARAM , __global const uint *normal_maps
#define NORMAL_MAP_ARG , normal_maps

inline float3 normal_texel(uint texel)
{
    const float x = (float)(short)(texel & 0xffffu) * (1.0f / 32767.0f);
    const float y = (float)(short)(texel >> 16) * (1.0f / 32767.0f);
    return (float3)(x, y, sqrt(max(1.0f - x * x - y * y, 0.0f)));
}

inline int normal_map_wrapped(int i, int n)
{
    const int r = i % n;
    return r < 0 ? r + n : r;
}

// The unit normal that `triangle` is shaded with at weights u and v of its corners 1 and 2, where
// `normal` is the interpolated one and `geometric` the triangle's own, both unit: the image's vector,
// bilinear with repeat, x and y scaled, along the interpolated tangent, the bitangent (its sign times
// normal x tangent; MikkTSpace) and the normal. One that would face the triangle's back is not used: a
// surface gets light on its front alone, whatever normal it is shaded with.
inline float3 mapped_normal(__global const uint *normal_maps, int triangle, float u, float v,
                            float3 normal, float3 geometric)
{
    const uint begin = normal_maps[triangle];
    if (begin == 0)
        return normal;
    __global const uint *row = normal_maps + begin;
    __global const float *f = (__global const float *)row;
    const float w = 1.0f - u - v;
    const float s = w * f[0] + u * f[2] + v * f[4], t = w * f[1] + u * f[3] + v * f[5];
    const int width = (int)row[7], height = (int)row[8];
    const float x = (s - floor(s)) * width - 0.5f;
    const float y = (1.0f - (t - floor(t))) * height - 0.5f;
    const float x_floor = floor(x), y_floor = floor(y);
    const int left = normal_map_wrapped((int)x_floor, width);
    const int right = normal_map_wrapped((int)x_floor + 1, width);
    __global const uint *top =
        normal_maps + row[6] + (size_t)normal_map_wrapped((int)y_floor, height) * width;
    __global const uint *bottom =
        normal_maps + row[6] + (size_t)normal_map_wrapped((int)y_floor + 1, height) * width;
    const float3 bent =
        mix(mix(normal_texel(top[left]), normal_texel(top[right]), x - x_floor),
            mix(normal_texel(bottom[left]), normal_texel(bottom[right]), x - x_floor), y - y_floor);
    const float3 tangent = w * (float3)(f[10], f[11], f[12]) + u * (float3)(f[14], f[15], f[16]) +
                           v * (float3)(f[18], f[19], f[20]);
    const float3 bitangent = f[13] * cross(normal, tangent);
    const float3 found =
        f[9] * (bent.x * tangent + bent.y * bitangent) + bent.z * normal;
    const float squared = dot(found, found);
    if (!(squared > 1e-12f) || dot(found, geometric) <= 0.0f)
        return normal;
    return found * (1.0f / sqrt(squared));
}
#else
#define NORMAL_MAP_PARAM
#define NORMAL_MAP_ARG
#endif

#endif
