// Tracing buffers of coherent rays, one work-item per 16 consecutive rays; buffers as in trace.cl.
#include "common/bvh_packet.cl"

// Component `axis` of 16 vectors from `first` on; the last vector repeats past the end.
inline float16 load_component(__global const float *vectors, int first, int count, int axis)
{
    float values[16];
    for (int i = 0; i < 16; i++)
        values[i] = vectors[3 * min(first + i, count - 1) + axis];
    return vload16(0, values);
}

inline float16 load_limits(__global const float *t_max, int limits, int first, int count)
{
    float values[16];
    for (int i = 0; i < 16; i++)
        values[i] = first + i < count ? t_max[min(first + i, limits - 1)] : 0.0f;
    return vload16(0, values);
}

// Closest hits.
__kernel void trace_closest(BVH_PARAMS, __global const float *origins,
                            __global const float *directions, __global const float *t_max,
                            int limits, int count, __global float4 *hits)
{
    const int first = 16 * get_global_id(0);
    if (first < count) {
        const Hit16 hit = bvh_closest_packet(
            BVH_ARGS, load_component(origins, first, count, 0),
            load_component(origins, first, count, 1), load_component(origins, first, count, 2),
            load_component(directions, first, count, 0), load_component(directions, first, count, 1),
            load_component(directions, first, count, 2), load_limits(t_max, limits, first, count));
        float t[16], u[16], v[16];
        int triangle[16];
        vstore16(hit.t, 0, t), vstore16(hit.u, 0, u), vstore16(hit.v, 0, v);
        vstore16(hit.triangle, 0, triangle);
        for (int i = 0; i < min(16, count - first); i++)
            hits[first + i] = (float4)(t[i], u[i], v[i], as_float(triangle[i]));
    }
}

// Any hit: 1 where the ray is blocked before t_max, else 0.
__kernel void trace_occluded(BVH_PARAMS, __global const float *origins,
                             __global const float *directions, __global const float *t_max,
                             int limits, int count, __global uchar *blocked)
{
    const int first = 16 * get_global_id(0);
    if (first < count) {
        const int16 hit = bvh_occluded_packet(
            BVH_ARGS, load_component(origins, first, count, 0),
            load_component(origins, first, count, 1), load_component(origins, first, count, 2),
            load_component(directions, first, count, 0), load_component(directions, first, count, 1),
            load_component(directions, first, count, 2), load_limits(t_max, limits, first, count));
        int found[16];
        vstore16(hit, 0, found);
        for (int i = 0; i < min(16, count - first); i++)
            blocked[first + i] = found[i] != 0;
    }
}
