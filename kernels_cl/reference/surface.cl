// Surfaces, textures and the environment for the reference path tracer.
#ifndef GIBENCH_REFERENCE_SURFACE
#define GIBENCH_REFERENCE_SURFACE
#include "common/vec.cl"

// A triangle is a record of TRIANGLE_FLOATS floats: positions, shading normals, texture coordinates of its
// three corners, material (an int's bits), three unused.
// A material is a record of MATERIAL_FLOATS floats: base colour, emission, texture (an int's bits, -1 for none),
// density of light samples on it (1/m2).

// The builtin guards against overflow, which costs more than all the rest.
inline float3 unit(float3 v)
{
    return v * (1.0f / sqrt(dot(v, v)));
}

typedef struct {
    float3 point;
    float3 geometric; // unit, on the front
    float3 shading;   // unit, within 90 degrees of the geometric one
    float2 uv;
    int material;
} Surface;

inline Surface surface_at(__global const float *triangles, int triangle, float u, float v)
{
    __global const float *t = triangles + (size_t)triangle * TRIANGLE_FLOATS;
    const float w = 1.0f - u - v;
    const float3 a = load3(t, 0), b = load3(t, 1), c = load3(t, 2);
    Surface s;
    s.point = a + u * (b - a) + v * (c - a);
    s.geometric = unit(cross(b - a, c - a));
    const float3 n = w * load3(t, 3) + u * load3(t, 4) + v * load3(t, 5);
    const float squared = dot(n, n);
    s.shading = squared > 1e-12f && dot(n, s.geometric) > 0.0f ? n * (1.0f / sqrt(squared)) : s.geometric;
    s.uv = (float2)(w * t[18] + u * t[20] + v * t[22], w * t[19] + u * t[21] + v * t[23]);
    s.material = as_int(t[24]);
    return s;
}

// A point moved off its surface by some units in the last place, so that a ray from it does not
// meet the surface again (Waechter and Binder 2019, "A Fast and Robust Method for Avoiding
// Self-Intersection", Ray Tracing Gems chapter 6, listing 6-1, with its constants). They are of scenes of
// metres; for one of millimetres RAY_SCALE (gibench/rays/offset.py) makes them smaller.
inline float off_surface(float p, float n)
{
    const int step = (int)(256.0f * n);
    const float moved = as_float(as_int(p) + (p < 0.0f ? -step : step));
    return fabs(p) < RAY_SCALE * 0.03125f ? p + RAY_SCALE * 1.52587890625e-05f * n : moved;
}

inline float3 leave_surface(float3 p, float3 n)
{
    return (float3)(off_surface(p.x, n.x), off_surface(p.y, n.y), off_surface(p.z, n.z));
}

inline int wrapped(int i, int n)
{
    if (i >= 0 && i < n)
        return i;
    const int r = i % n;
    return r < 0 ? r + n : r;
}

// Bilinear with repeat; v points upwards, row 0 is the top. `images` holds (first pixel, width,
// height) per texture.
inline float3 texture_at(__global const float *pixels, __global const int *images, int texture,
                         float2 uv)
{
    __global const int *image = images + 3 * texture;
    const int width = image[1], height = image[2];
    const float x = (uv.x - floor(uv.x)) * width - 0.5f;
    const float y = (1.0f - (uv.y - floor(uv.y))) * height - 0.5f;
    const float x0 = floor(x), y0 = floor(y);
    const float fx = x - x0, fy = y - y0;
    const int left = wrapped((int)x0, width), right = wrapped((int)x0 + 1, width);
    const size_t top = (size_t)image[0] + (size_t)wrapped((int)y0, height) * width;
    const size_t bottom = (size_t)image[0] + (size_t)wrapped((int)y0 + 1, height) * width;
    return mix(mix(load3(pixels, top + left), load3(pixels, top + right), fx),
               mix(load3(pixels, bottom + left), load3(pixels, bottom + right), fx), fy);
}

// Where a direction lies on an equirectangular image of width x height pixels (0 to width, 0 to
// height), as gibench.scene.model.Environment has it.
inline float2 environment_pixel(float3 d, int width, int height)
{
    const float x = width > 1 ? (atan2(d.x, -d.z) * (0.5f * INV_PI_F) + 0.5f) * width : 0.5f;
    const float y = height > 1 ? acos(clamp(d.y, -1.0f, 1.0f)) * INV_PI_F * height : 0.5f;
    return (float2)(x, y);
}

// Radiance there: bilinear, wrapping across, clamped at the poles.
inline float3 environment_at(__global const float *pixels, int width, int height, float2 pixel)
{
    const float2 at = pixel - 0.5f;
    const float2 whole = floor(at), part = at - whole;
    const int left = wrapped((int)whole.x, width), right = wrapped((int)whole.x + 1, width);
    const size_t top = (size_t)clamp((int)whole.y, 0, height - 1) * width;
    const size_t bottom = (size_t)clamp((int)whole.y + 1, 0, height - 1) * width;
    return mix(mix(load3(pixels, top + left), load3(pixels, top + right), part.x),
               mix(load3(pixels, bottom + left), load3(pixels, bottom + right), part.x), part.y);
}

#endif
