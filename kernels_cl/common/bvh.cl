// Closest hit and any hit through the 8-wide tree that gibench/rays/bvh.py builds.
//
// Nodes (bvh_nodes, 56 floats each): lower x of the 8 children, upper x, lower y, upper y, lower z,
// upper z, then the children as int: a node's number, or the complement of
// 4 * (first block) + (blocks - 1) of a leaf. Missing children have lower = inf, upper = -inf.
// Blocks (bvh_triangles, 80 floats each): corner 0 x of 8 triangles, y, z, corner 1, corner 2, then
// the scene's triangle numbers as int. Missing triangles are degenerate.
//
// Boxes: slabs, (bound - origin) / direction with the far side widened by 3 ulp, so that rounding
// loses no box (Ize 2013, "Robust BVH Ray Traversal"). Triangles: the watertight test of Woop,
// Benthin and Wald 2013, without its second attempt in double precision: a ray that float32 puts
// exactly on an edge hits both triangles of the edge.
// Children are visited near to far from a stack that keeps distances.
#ifndef GIBENCH_BVH
#define GIBENCH_BVH

#include "common/cutout.cl"
#include "common/vec.cl"

// RAY_COUNTS=1, an instrumented build (gibench/device/program.py): every kernel that takes BVH_PARAMS
// takes ray_counts too and adds its closest-hit rays to the first word and its any-hit rays to the
// second. Results stay the same.
#if RAY_COUNTS
#define BVH_PARAMS                                                                                  \
    __global const float *bvh_nodes, __global const float *bvh_triangles, __global uint *ray_counts \
        CUTOUT_PARAM
#define BVH_ARGS_OF(nodes, triangles) nodes, triangles, ray_counts CUTOUT_ARG
#define BVH_COUNT_CLOSEST() atomic_inc(ray_counts)
#define BVH_COUNT_OCCLUDED() atomic_inc(ray_counts + 1)
#define BVH_COUNTS 1
#else
#define BVH_PARAMS \
    __global const float *bvh_nodes, __global const float *bvh_triangles CUTOUT_PARAM
#define BVH_ARGS_OF(nodes, triangles) nodes, triangles CUTOUT_ARG
#define BVH_COUNT_CLOSEST()
#define BVH_COUNT_OCCLUDED()
#define BVH_COUNTS 0
#endif
#define BVH_ARGS BVH_ARGS_OF(bvh_nodes, bvh_triangles)

typedef struct {
    float t; // in units of the direction's length; INFINITY on a miss
    float u; // barycentric weight of corner 1
    float v; // barycentric weight of corner 2
    int triangle; // scene triangle, -1 on a miss
} Hit;

// What a ray keeps during traversal: for boxes the offsets of its near and far planes in a node, for
// triangles the shear that makes it the unit ray along its longest axis.
typedef struct {
    float3 origin;
    float3 inverse;
    int near_x, near_y, near_z;
    int kx, ky, kz;
    float ox, oy, oz;
    float sx, sy, sz;
} BvhRay;

// PoCL compiles vloadn, min and max to calls around which every vector register is spilled;
// aligned vector pointers and ?: compile to single instructions. (bvh_nodes and bvh_triangles are
// aligned to 32 bytes, and so are their rows' 8-float parts.)
inline float8 bvh_load8(__global const float *p)
{
    return *(__global const float8 *)p;
}

inline float8 bvh_min8(float8 a, float8 b)
{
    return a < b ? a : b;
}

inline float8 bvh_max8(float8 a, float8 b)
{
    return a > b ? a : b;
}

// Sign bits of 8 lanes as bits 0 to 7.
inline uint bvh_mask(int8 lanes)
{
#if defined(__AVX2__) && defined(__clang__)
    return (uint)__builtin_ia32_movmskps256(as_float8(lanes));
#else
    const int8 bits = lanes & (int8)(1, 2, 4, 8, 16, 32, 64, 128);
    const int4 b = bits.lo | bits.hi;
    const int2 c = b.lo | b.hi;
    return (uint)(c.x | c.y);
#endif
}

// Index of the lowest set bit.
inline uint bvh_lowest(uint mask)
{
    return 31u - clz(mask & (0u - mask));
}

inline float bvh_safe_inverse(float d)
{
    return 1.0f / copysign(fmax(fabs(d), 1e-18f), d);
}

inline BvhRay bvh_ray(float3 origin, float3 direction)
{
    BvhRay r;
    r.origin = origin;
    r.inverse = (float3)(bvh_safe_inverse(direction.x), bvh_safe_inverse(direction.y),
                         bvh_safe_inverse(direction.z));
    r.near_x = r.inverse.x < 0.0f ? 8 : 0;
    r.near_y = r.inverse.y < 0.0f ? 24 : 16;
    r.near_z = r.inverse.z < 0.0f ? 40 : 32;
    const float3 a = fabs(direction);
    if (a.x >= a.y && a.x >= a.z) {
        r.kx = 8, r.ky = 16, r.kz = 0;
        r.ox = origin.y, r.oy = origin.z, r.oz = origin.x;
        r.sz = 1.0f / direction.x;
        r.sx = direction.y * r.sz, r.sy = direction.z * r.sz;
    } else if (a.y >= a.z) {
        r.kx = 16, r.ky = 0, r.kz = 8;
        r.ox = origin.z, r.oy = origin.x, r.oz = origin.y;
        r.sz = 1.0f / direction.y;
        r.sx = direction.z * r.sz, r.sy = direction.x * r.sz;
    } else {
        r.kx = 0, r.ky = 8, r.kz = 16;
        r.ox = origin.x, r.oy = origin.y, r.oz = origin.z;
        r.sz = 1.0f / direction.z;
        r.sx = direction.x * r.sz, r.sy = direction.y * r.sz;
    }
    return r;
}

// Entry distances of the node's 8 boxes and which of them the ray meets before t_max.
inline uint bvh_boxes(__global const float *node, const BvhRay *r, float t_max, float8 *entry)
{
    const float8 ox = r->origin.x, oy = r->origin.y, oz = r->origin.z;
    const float8 ix = r->inverse.x, iy = r->inverse.y, iz = r->inverse.z;
    const float8 nx = (bvh_load8(node + r->near_x) - ox) * ix;
    const float8 ny = (bvh_load8(node + r->near_y) - oy) * iy;
    const float8 nz = (bvh_load8(node + r->near_z) - oz) * iz;
    const float8 fx = (bvh_load8(node + (r->near_x ^ 8)) - ox) * ix;
    const float8 fy = (bvh_load8(node + (r->near_y ^ 8)) - oy) * iy;
    const float8 fz = (bvh_load8(node + (r->near_z ^ 8)) - oz) * iz;
    const float8 enter = bvh_max8(bvh_max8(nx, ny), bvh_max8(nz, (float8)(0.0f)));
    const float8 leave = bvh_min8(bvh_min8(fx, fy), bvh_min8(fz, (float8)(t_max))) * 1.0000004f;
    *entry = enter;
    return bvh_mask(enter <= leave);
}

// a b - c d with both products rounded before they are subtracted: the sign is then never wrong, at
// worst the value is 0, which counts as inside on both sides of an edge. Contracted to a fused
// multiply-add it would be wrong now and then, and rays would slip through corners.
inline float8 bvh_edge(float8 a, float8 b, float8 c, float8 d)
{
#pragma OPENCL FP_CONTRACT OFF
    const float8 p = a * b;
    const float8 q = c * d;
    return p - q;
}

// Which of a block's 8 triangles the ray hits in (0, t_max); their distances and barycentrics.
inline uint bvh_block(__global const float *block, const BvhRay *r, float t_max, float8 *t,
                      float8 *u, float8 *v)
{
    const float8 ox = r->ox, oy = r->oy, oz = r->oz;
    const float8 sx = r->sx, sy = r->sy;
    const float8 az = bvh_load8(block + r->kz) - oz;
    const float8 bz = bvh_load8(block + 24 + r->kz) - oz;
    const float8 cz = bvh_load8(block + 48 + r->kz) - oz;
    const float8 ax = (bvh_load8(block + r->kx) - ox) - sx * az;
    const float8 bx = (bvh_load8(block + 24 + r->kx) - ox) - sx * bz;
    const float8 cx = (bvh_load8(block + 48 + r->kx) - ox) - sx * cz;
    const float8 ay = (bvh_load8(block + r->ky) - oy) - sy * az;
    const float8 by = (bvh_load8(block + 24 + r->ky) - oy) - sy * bz;
    const float8 cy = (bvh_load8(block + 48 + r->ky) - oy) - sy * cz;
    const float8 e0 = bvh_edge(cx, by, cy, bx);
    const float8 e1 = bvh_edge(ax, cy, ay, cx);
    const float8 e2 = bvh_edge(bx, ay, by, ax);
    const float8 det = e0 + e1 + e2;
    const int8 inside = ((e0 >= 0.0f) & (e1 >= 0.0f) & (e2 >= 0.0f))
        | ((e0 <= 0.0f) & (e1 <= 0.0f) & (e2 <= 0.0f));
    const float8 inverse = 1.0f / det;
    const float8 distance = (e0 * az + e1 * bz + e2 * cz) * r->sz * inverse;
    *t = distance;
    *u = e1 * inverse;
    *v = e2 * inverse;
    return bvh_mask(inside & (distance > 0.0f) & (distance < t_max) & (det != 0.0f));
}

#if CUTOUTS
// Which of a block's triangles in `mask` are there, where the ray hits them.
inline uint bvh_there(__global const float *block, uint mask, float8 u, float8 v CUTOUT_PARAM)
{
    float us[8] __attribute__((aligned(32))), vs[8] __attribute__((aligned(32)));
    *(float8 *)us = u;
    *(float8 *)vs = v;
    uint there = 0;
    while (mask) {
        const uint i = bvh_lowest(mask);
        mask &= mask - 1;
        if (!cut_away(cutouts, ((__global const int *)(block + 72))[i], us[i], vs[i]))
            there |= 1u << i;
    }
    return there;
}
#endif

// The nearest of a node's children in `mask` (not 0); the others go on the stack, farthest first.
inline int bvh_push(__global const float *node, uint mask, float8 entry, int *nodes,
                    float *distances, int *top)
{
    __global const int *children = (__global const int *)(node + 48);
    uint i = bvh_lowest(mask);
    mask &= mask - 1;
    int current = children[i];
    if (mask == 0)
        return current;
    float entries[8] __attribute__((aligned(32)));
    *(float8 *)entries = entry;
    float nearest = entries[i];
    const int bottom = *top;
    int end = bottom;
    do {
        i = bvh_lowest(mask);
        mask &= mask - 1;
        float d = entries[i];
        int child = children[i];
        if (d < nearest) {
            const float far = nearest;
            const int far_child = current;
            nearest = d;
            current = child;
            d = far;
            child = far_child;
        }
        int at = end++;
        while (at > bottom && distances[at - 1] < d) {
            distances[at] = distances[at - 1];
            nodes[at] = nodes[at - 1];
            at--;
        }
        distances[at] = d;
        nodes[at] = child;
    } while (mask);
    *top = end;
    return current;
}

// The closest hit at a distance in (0, t_max).
inline Hit bvh_closest(BVH_PARAMS, float3 origin, float3 direction, float t_max)
{
    BVH_COUNT_CLOSEST();
    const BvhRay r = bvh_ray(origin, direction);
    Hit hit = {INFINITY, 0.0f, 0.0f, -1};
    float limit = t_max;
    int nodes[BVH_STACK];
    float distances[BVH_STACK];
    int top = 0;
    int current = 0;
    while (true) {
        // Down to a leaf, nearest child first.
        while (current >= 0) {
            __global const float *node = bvh_nodes + (size_t)current * BVH_NODE_FLOATS;
            float8 entry;
            const uint mask = bvh_boxes(node, &r, limit, &entry);
            if (mask == 0) {
                current = INT_MIN;
                break;
            }
            current = bvh_push(node, mask, entry, nodes, distances, &top);
        }
        if (current != INT_MIN) {
            const uint leaf = (uint)~current;
            __global const float *block = bvh_triangles + (size_t)(leaf >> 2) * BVH_BLOCK_FLOATS;
            __global const float *end = block + ((leaf & 3) + 1) * BVH_BLOCK_FLOATS;
            for (; block != end; block += BVH_BLOCK_FLOATS) {
                float8 t, u, v;
                uint mask = bvh_block(block, &r, limit, &t, &u, &v);
#if CUTOUTS
                if (mask)
                    mask = bvh_there(block, mask, u, v CUTOUT_ARG);
#endif
                if (mask) {
                    float ts[8] __attribute__((aligned(32))), us[8] __attribute__((aligned(32)));
                    float vs[8] __attribute__((aligned(32)));
                    *(float8 *)ts = t;
                    *(float8 *)us = u;
                    *(float8 *)vs = v;
                    do {
                        const uint i = bvh_lowest(mask);
                        mask &= mask - 1;
                        if (ts[i] < limit) {
                            limit = ts[i];
                            hit.t = ts[i];
                            hit.u = us[i];
                            hit.v = vs[i];
                            hit.triangle = ((__global const int *)(block + 72))[i];
                        }
                    } while (mask);
                }
            }
        }
        do {
            if (top == 0)
                return hit;
            top--;
        } while (distances[top] >= limit);
        current = nodes[top];
    }
}

// Whether anything is hit at a distance in (0, t_max).
inline bool bvh_occluded(BVH_PARAMS, float3 origin, float3 direction, float t_max)
{
    BVH_COUNT_OCCLUDED();
    const BvhRay r = bvh_ray(origin, direction);
    int nodes[BVH_STACK];
    int top = 0;
    int current = 0;
    while (true) {
        if (current >= 0) {
            __global const float *node = bvh_nodes + (size_t)current * BVH_NODE_FLOATS;
            __global const int *children = (__global const int *)(node + 48);
            float8 entry;
            uint mask = bvh_boxes(node, &r, t_max, &entry);
            while (mask) {
                nodes[top++] = children[bvh_lowest(mask)];
                mask &= mask - 1;
            }
        } else {
            const uint leaf = (uint)~current;
            __global const float *block = bvh_triangles + (size_t)(leaf >> 2) * BVH_BLOCK_FLOATS;
            __global const float *end = block + ((leaf & 3) + 1) * BVH_BLOCK_FLOATS;
            for (; block != end; block += BVH_BLOCK_FLOATS) {
                float8 t, u, v;
#if CUTOUTS
                const uint mask = bvh_block(block, &r, t_max, &t, &u, &v);
                if (mask && bvh_there(block, mask, u, v CUTOUT_ARG))
                    return true;
#else
                if (bvh_block(block, &r, t_max, &t, &u, &v))
                    return true;
#endif
            }
        }
        if (top == 0)
            return false;
        current = nodes[--top];
    }
}

#endif
