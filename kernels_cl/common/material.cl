// What a ray finds on a surface: position, normals, albedo, emission.
//
// A material is a row of MATERIAL_FLOATS numbers and one of MATERIAL_SLOTS texture slots. What is where
// is declared once, in gibench.techniques.parts.material_table, which gives the macros: MATERIAL_<FIELD>
// is a field's first number, MATERIAL_<SLOT> a slot's place. Kernels ask for both by name alone.
#ifndef GIBENCH_MATERIAL
#define GIBENCH_MATERIAL

#include "common/vec.cl"
#include "common/bvh.cl"
#include "common/glow.cl"

// positions, normals   (v, 3) per vertex        uvs         (v, 2) per vertex, v upwards
// triangles            (t, 3) vertex indices    material_ids (t,)
// materials            (m, MATERIAL_FLOATS)
// material_textures    (m, MATERIAL_SLOTS, 3) first texel in `texels`, width, height; first is -1
//                      without texture
// texels               sRGB-encoded colours of all textures, rows from the top
// srgb_to_linear       (256,) what an encoded byte means
// glow                 only where GLOW=1, see common/glow.cl
// SHAPE_PARAMS is what tells a surface's shape alone.
#define SHAPE_PARAMS                                                     \
    __global const float *positions, __global const float *normals, \
        __global const int *triangles
#define SHAPE_ARGS positions, normals, triangles
#define SURFACE_PARAMS                                                                       \
    __global const float *positions, __global const float *normals, __global const float *uvs, \
        __global const int *triangles, __global const int *material_ids,                       \
        __global const float *materials, __global const int *material_textures,                \
        __global const uchar4 *texels, __global const float *srgb_to_linear GLOW_PARAM
#define SURFACE_ARGS                                                                        \
    positions, normals, uvs, triangles, material_ids, materials, material_textures, texels, \
        srgb_to_linear GLOW_ARG

typedef struct {
    float3 position;         // m, interpolated from the corners (more exact than along the ray)
    float3 geometric_normal; // unit, on the front
    float3 normal;           // unit shading normal
    float3 albedo;
    float3 emission; // W/m2/sr
} Surface;

inline float3 decoded(uchar4 c, __global const float *srgb_to_linear)
{
    return (float3)(srgb_to_linear[c.x], srgb_to_linear[c.y], srgb_to_linear[c.z]);
}

inline int wrapped(int i, int n)
{
    const int r = i % n;
    return r < 0 ? r + n : r;
}

// Bilinear with repeat; row 0 is v = 1.
inline float3 texture_bilinear(__global const uchar4 *image, int width, int height, float2 uv,
                               __global const float *srgb_to_linear)
{
    const float x = (uv.x - floor(uv.x)) * width - 0.5f;
    const float y = (1.0f - (uv.y - floor(uv.y))) * height - 0.5f;
    const float x_floor = floor(x), y_floor = floor(y);
    const int x0 = wrapped((int)x_floor, width), x1 = wrapped((int)x_floor + 1, width);
    const int y0 = wrapped((int)y_floor, height), y1 = wrapped((int)y_floor + 1, height);
    __global const uchar4 *top = image + (size_t)y0 * width;
    __global const uchar4 *bottom = image + (size_t)y1 * width;
    return mix(mix(decoded(top[x0], srgb_to_linear), decoded(top[x1], srgb_to_linear),
                   x - x_floor),
               mix(decoded(bottom[x0], srgb_to_linear), decoded(bottom[x1], srgb_to_linear),
                   x - x_floor),
               y - y_floor);
}

// The colour of a material that starts at `field`.
inline float3 material_color(__global const float *materials, int id, int field)
{
    return load3(materials + MATERIAL_FLOATS * id + field, 0);
}

// A texture slot of a material; x is -1 where it has none.
inline int3 material_texture(__global const int *material_textures, int id, int slot)
{
    return vload3(MATERIAL_SLOTS * id + slot, material_textures);
}

// The surface's shape at a hit; albedo and emission are left out.
inline Surface surface_shape(SHAPE_PARAMS, Hit hit)
{
    Surface s;
    const int3 c = vload3(hit.triangle, triangles);
    const float w = 1.0f - hit.u - hit.v;
    const float3 p0 = load3(positions, c.x), p1 = load3(positions, c.y), p2 = load3(positions, c.z);
    s.position = w * p0 + hit.u * p1 + hit.v * p2;
    s.geometric_normal = normalize(cross(p1 - p0, p2 - p0));
    s.normal = normalize(w * load3(normals, c.x) + hit.u * load3(normals, c.y) +
                         hit.v * load3(normals, c.z));
    return s;
}

inline Surface surface_at(SURFACE_PARAMS, Hit hit)
{
    Surface s = surface_shape(SHAPE_ARGS, hit);
    const int id = material_ids[hit.triangle];
    s.albedo = material_color(materials, id, MATERIAL_BASE_COLOR);
    s.emission = material_color(materials, id, MATERIAL_EMISSION);
#if GLOW
    s.emission = glow_at(glow, hit.triangle, hit.u, hit.v, s.emission);
#endif
    const int3 image = material_texture(material_textures, id, MATERIAL_BASE_COLOR_TEXTURE);
    if (image.x >= 0) {
        const int3 c = vload3(hit.triangle, triangles);
        const float w = 1.0f - hit.u - hit.v;
        const float2 uv = w * vload2(c.x, uvs) + hit.u * vload2(c.y, uvs) + hit.v * vload2(c.z, uvs);
        s.albedo *= texture_bilinear(texels + image.x, image.y, image.z, uv, srgb_to_linear);
    }
    return s;
}

#endif
