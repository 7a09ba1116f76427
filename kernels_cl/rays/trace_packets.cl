// Tracing buffers of coherent rays, one work-item per PACKET consecutive rays; buffers as in trace.cl.
#include "common/bvh_packet.cl"

// Component `axis` of PACKET vectors from `first` on; the last vector repeats past the end.
inline pfloat load_component(__global const float *vectors, int first, int count, int axis)
{
    float values[PACKET];
    for (int i = 0; i < PACKET; i++)
        values[i] = vectors[3 * min(first + i, count - 1) + axis];
    return pload(0, values);
}

inline pfloat load_limits(__global const float *t_max, int limits, int first, int count)
{
    float values[PACKET];
    for (int i = 0; i < PACKET; i++)
        values[i] = first + i < count ? t_max[min(first + i, limits - 1)] : 0.0f;
    return pload(0, values);
}

// Closest hits.
__kernel void trace_closest(BVH_PARAMS, __global const float *origins,
                            __global const float *directions, __global const float *t_max,
                            int limits, int count, __global float4 *hits)
{
    const int first = PACKET * get_global_id(0);
    if (first < count) {
        const HitPacket hit = bvh_closest_packet(
            BVH_ARGS, load_component(origins, first, count, 0),
            load_component(origins, first, count, 1), load_component(origins, first, count, 2),
            load_component(directions, first, count, 0), load_component(directions, first, count, 1),
            load_component(directions, first, count, 2), load_limits(t_max, limits, first, count));
        float t[PACKET], u[PACKET], v[PACKET];
        int triangle[PACKET];
        pstore(hit.t, 0, t), pstore(hit.u, 0, u), pstore(hit.v, 0, v);
        pstore(hit.triangle, 0, triangle);
        for (int i = 0; i < min(PACKET, count - first); i++)
            hits[first + i] = (float4)(t[i], u[i], v[i], as_float(triangle[i]));
    }
}

// Any hit: 1 where the ray is blocked before t_max, else 0.
__kernel void trace_occluded(BVH_PARAMS, __global const float *origins,
                             __global const float *directions, __global const float *t_max,
                             int limits, int count, __global uchar *blocked)
{
    const int first = PACKET * get_global_id(0);
    if (first < count) {
        const pint hit = bvh_occluded_packet(
            BVH_ARGS, load_component(origins, first, count, 0),
            load_component(origins, first, count, 1), load_component(origins, first, count, 2),
            load_component(directions, first, count, 0), load_component(directions, first, count, 1),
            load_component(directions, first, count, 2), load_limits(t_max, limits, first, count));
        int found[PACKET];
        pstore(hit, 0, found);
        for (int i = 0; i < min(PACKET, count - first); i++)
            blocked[first + i] = found[i] != 0;
    }
}
