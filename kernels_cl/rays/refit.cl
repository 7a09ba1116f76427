// Objects that move: their vertices put where they are in the frame, and the tree of common/bvh.cl
// refitted to them from the leaves up. The tree's shape stays; see gibench/rays/refit.py, which makes
// the lists of what to visit.
//
// Bounds are least and greatest coordinates of the very floats that the triangle test reads: exact,
// with no rounding that could lose a hit.
#include "common/bvh.cl"
#include "common/rigid.cl"

// move_vertices: one work-item per moving vertex.
// transforms: (objects, 12) object to world, 3 x 4 row-major, rigid, this frame's. vertices: (count,)
// where each lies in positions and normals. vertex_objects: (count,) whose it is, from 0.
// rest_positions, rest_normals: (count, 3) in object space. positions, normals: (v, 3), written.
__kernel void move_vertices(__global const float *transforms, __global const int *vertices,
                            __global const int *vertex_objects,
                            __global const float *rest_positions,
                            __global const float *rest_normals, int count,
                            __global float *positions, __global float *normals)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const Rigid object = rigid_load(transforms, vertex_objects[i]);
    const int at = vertices[i];
    store3(positions, at, rigid_point(&object, load3(rest_positions, i)));
    store3(normals, at, rigid_direction(&object, load3(rest_normals, i)));
}

// refit_leaves: one work-item per moving triangle; its corners into its leaf block.
// slots: (count,) 8 * block + lane. triangles: (t, 3) vertex indices. blocks: bvh_triangles, written.
__kernel void refit_leaves(__global const int *slots, int count, __global const int *triangles,
                           __global const float *positions, __global float *blocks)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int slot = slots[i];
    __global float *lane = blocks + (size_t)(slot >> 3) * BVH_BLOCK_FLOATS + (slot & 7);
    const int triangle = as_int(lane[72]);
    for (int corner = 0; corner < 3; ++corner) {
        const float3 p = load3(positions, triangles[3 * triangle + corner]);
        lane[24 * corner] = p.x;
        lane[24 * corner + 8] = p.y;
        lane[24 * corner + 16] = p.z;
    }
}

inline float refit_least(float8 a)
{
    const float4 b = a.lo < a.hi ? a.lo : a.hi;
    const float2 c = b.lo < b.hi ? b.lo : b.hi;
    return c.x < c.y ? c.x : c.y;
}

// Least and greatest along one axis of the triangles in `blocks` blocks; missing ones do not count.
inline float2 refit_leaf(__global const float *block, int blocks, int axis)
{
    float8 low = (float8)(INFINITY), high = (float8)(-INFINITY);
    for (int b = 0; b < blocks; ++b, block += BVH_BLOCK_FLOATS) {
        const int8 there = *(__global const int8 *)(block + 72) >= 0;
        for (int corner = 0; corner < 3; ++corner) {
            const float8 p = bvh_load8(block + 24 * corner + 8 * axis);
            low = there ? bvh_min8(low, p) : low;
            high = there ? bvh_max8(high, p) : high;
        }
    }
    return (float2)(refit_least(low), -refit_least(-high));
}

// refit_nodes: one work-item per child whose triangles move, all of one level; levels come deepest
// first. Its bounds are those of its leaf's triangles or, where it is a node, of that node's children
// (missing ones have lower = inf, upper = -inf), which the launch before has set.
// slots: 8 * node + child; those from `first` on, `count` of them. nodes: bvh_nodes, read and written.
__kernel void refit_nodes(__global const int *slots, int first, int count,
                          __global const float *bvh_triangles, __global float *nodes)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int slot = slots[first + i];
    __global float *bounds = nodes + (size_t)(slot >> 3) * BVH_NODE_FLOATS + (slot & 7);
    const int child = as_int(bounds[48]);
    for (int axis = 0; axis < 3; ++axis) {
        float2 range;
        if (child < 0) {
            const uint leaf = (uint)~child;
            range = refit_leaf(bvh_triangles + (size_t)(leaf >> 2) * BVH_BLOCK_FLOATS,
                               (leaf & 3) + 1, axis);
        } else {
            __global const float *below = nodes + (size_t)child * BVH_NODE_FLOATS + 16 * axis;
            range = (float2)(refit_least(bvh_load8(below)), -refit_least(-bvh_load8(below + 8)));
        }
        bounds[16 * axis] = range.x;
        bounds[16 * axis + 8] = range.y;
    }
}
