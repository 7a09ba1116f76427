// Tracing buffers of rays, one work-item per ray.
#include "common/bvh.cl"

// Closest hits. Rays are 3 floats of origin and of direction; t_max one float per ray, or one in all
// (limits = 1). Hits are 4 floats: t, u, v, and the triangle as int.
__kernel void trace_closest(BVH_PARAMS, __global const float *origins,
                            __global const float *directions, __global const float *t_max,
                            int limits, int count, __global float4 *hits)
{
    const int i = get_global_id(0);
    if (i < count) {
        const Hit hit = bvh_closest(BVH_ARGS, load3(origins, i), load3(directions, i),
                                    t_max[min(i, limits - 1)]);
        hits[i] = (float4)(hit.t, hit.u, hit.v, as_float(hit.triangle));
    }
}

// Any hit: 1 where the ray is blocked before t_max, else 0. Layout as above.
__kernel void trace_occluded(BVH_PARAMS, __global const float *origins,
                             __global const float *directions, __global const float *t_max,
                             int limits, int count, __global uchar *blocked)
{
    const int i = get_global_id(0);
    if (i < count)
        blocked[i] = bvh_occluded(BVH_ARGS, load3(origins, i), load3(directions, i),
                                  t_max[min(i, limits - 1)]);
}
