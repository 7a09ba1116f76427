// What of a pixel is kept for the passes after the camera's.
// Macros, of gibench.techniques.parts.macros: GBUFFER, one of
//   GBUFFER_NONE     nothing
//   GBUFFER_HIT      where the surface is hit and its albedo: compact
//   GBUFFER_SURFACE  the surface there: for passes that look at pixels again and again
// and GBUFFER_FLOATS.
#ifndef GIBENCH_GBUFFER
#define GIBENCH_GBUFFER

#include "common/bvh.cl"
#include "common/material.cl"

// gbuffer     GBUFFER_HIT: GBUFFER_FLOATS floats for each work-item, in the order that pixels are
//             visited in (common/pixels.cl): triangle (an int; -1 where no surface's front shows),
//             its barycentrics u and v, albedo. What a pixel without a surface holds besides is not
//             written.
// g_position  GBUFFER_SURFACE, row by row: position, m, and the object's number from 1 (an int); 0
//             where no surface's front shows
// g_normal    unit shading normal     g_albedo   albedo
// object_of   (triangles,) object numbers from 0

#if GBUFFER == GBUFFER_NONE
#define KEPT_PARAMS
#define KEEP(item, at, hit, surface)
#define KEEP_NOTHING(item, at)
#elif GBUFFER == GBUFFER_HIT
#define KEPT_PARAMS __global float *gbuffer,
#define KEEP(item, at, hit, surface) keep_hit(gbuffer, item, hit, (surface).albedo)
#define KEEP_NOTHING(item, at) keep_no_hit(gbuffer, item)
#else
#define KEPT_PARAMS                                                                          \
    __global const int *object_of, __global float4 *g_position, __global float4 *g_normal,   \
        __global float4 *g_albedo,
#define KEEP(item, at, hit, surface)                                                          \
    keep_surface(g_position, g_normal, g_albedo, at, object_of[(hit).triangle] + 1,           \
                 (surface).position, (surface).normal, (surface).albedo)
#define KEEP_NOTHING(item, at)                                                                \
    keep_surface(g_position, g_normal, g_albedo, at, 0, (float3)(0.0f), (float3)(0.0f),       \
                 (float3)(0.0f))
#endif

inline void keep_hit(__global float *gbuffer, int item, Hit hit, float3 albedo)
{
    __global float *kept = gbuffer + (size_t)GBUFFER_FLOATS * item;
    kept[0] = as_float(hit.triangle);
    kept[1] = hit.u;
    kept[2] = hit.v;
    store3(kept, 1, albedo);
}

inline void keep_no_hit(__global float *gbuffer, int item)
{
    gbuffer[(size_t)GBUFFER_FLOATS * item] = as_float(-1);
}

typedef struct {
    Hit hit; // its distance is not kept
    float3 albedo;
} Kept;

inline Kept kept_hit(__global const float *gbuffer, int item)
{
    __global const float *kept = gbuffer + (size_t)GBUFFER_FLOATS * item;
    Kept k;
    k.hit.t = 0.0f;
    k.hit.triangle = as_int(kept[0]);
    if (k.hit.triangle >= 0) {
        k.hit.u = kept[1];
        k.hit.v = kept[2];
        k.albedo = load3(kept, 1);
    }
    return k;
}

inline void keep_surface(__global float4 *g_position, __global float4 *g_normal,
                         __global float4 *g_albedo, int at, int object, float3 position,
                         float3 normal, float3 albedo)
{
    g_position[at] = (float4)(position, as_float(object));
    g_normal[at] = (float4)(normal, 0.0f);
    g_albedo[at] = (float4)(albedo, 0.0f);
}

#endif
