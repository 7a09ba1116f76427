// Blending of ddgi/tuned_blend.cl for devices that run work-items in lockstep.
//
// The lists of rays are the same. A texel's list is made by a work-group, which fetches and stores
// what lies side by side. The products are made by groups of any size for LANES probes by TEXELS
// texels: one texel after the other, whose list all work-items read, while neighbours are neighbouring
// probes, whose rays lie beside each other. Once they have their sums they change places in local
// memory, so that neighbours then are neighbouring texels of one map. Where a CPU makes vectors of
// work-items (VECTOR of them, else 0), these exchange nothing, which costs such a device more than it
// saves: each writes what it has summed, and makes a texel's list by itself. No local memory is used
// then. Macros: LANES, TEXELS, TEAM (the work-group's size in the products), LISTED (rays at a time as
// lists are made), VECTOR, and that of ddgi/lists.cl.
#include "ddgi/lists.cl"

// blend_weights: one work-group per texel; where VECTOR, per so many of them.
//   The list of each (ddgi/lists.cl).
// lengths: (texels,), multiples of LIST_STEP. list_rays, list_weights: (texels, LIST_LENGTH).
// Neighbours compute neighbouring rays' cosines; then each counts a run of them and finds their
// places, behind those of the runs before. staged: 3 * LISTED floats; cosines: LISTED; counted: a word
// per work-item.
__kernel void blend_weights(__global const float *directions, int side, int sharp, float least,
                            __global int *lengths, __global int *list_rays,
                            __global float *list_weights, __local float *staged,
                            __local float *cosines, __local uint *counted)
{
#if VECTOR
    // One vector of the group computes, the others end at once: more groups, more even shares.
    const int texel = (int)get_group_id(0) * VECTOR + (int)get_local_id(0);
    if (get_local_id(0) >= VECTOR || texel >= side * side)
        return;
    lengths[texel] = make_list(texel, side, sharp, least, directions, list_rays, list_weights);
#else
    const size_t item = get_local_id(0), size = get_local_size(0);
    const int texel = get_group_id(0);
    const float3 towards = texel_direction(texel, side);
    __global int *own_rays = list_rays + (size_t)texel * LIST_LENGTH;
    __global float *own_weights = list_weights + (size_t)texel * LIST_LENGTH;
    int length = 0;
    for (int first = 0; first < BLENDED; first += LISTED) {
        const int count = min(LISTED, BLENDED - first);
        __global const float *from = directions + 3 * (FIXED + first);
        for (size_t turn = 0; turn < (size_t)(3 * count); turn += size)
            if (turn + item < (size_t)(3 * count))
                staged[turn + item] = from[turn + item];
        barrier(CLK_LOCAL_MEM_FENCE);
        for (size_t turn = 0; turn < (size_t)count; turn += size)
            if (turn + item < (size_t)count) {
                __local const float *d = staged + 3 * (turn + item);
                cosines[turn + item] = dot(towards, (float3)(d[0], d[1], d[2]));
            }
        barrier(CLK_LOCAL_MEM_FENCE);
        const int run = (count + (int)size - 1) / (int)size;
        const int begin = min((int)item * run, count), end = min(begin + run, count);
        uint own = 0;
        for (int i = begin; i < end; ++i)
            own += cosines[i] > least ? 1 : 0;
        counted[item] = own;
        barrier(CLK_LOCAL_MEM_FENCE);
        // Each adds up the others', all reading the same one: no barrier more, where a scan takes more
        // than its additions.
        int before = 0, all = 0;
        for (size_t other = 0; other < size; ++other) {
            const int one = counted[other];
            before += other < item ? one : 0;
            all += one;
        }
        // A ray's place takes that of its direction; neighbours then store to neighbouring places.
        float at = (float)(length + before);
        for (int i = begin; i < end; ++i) {
            staged[3 * i] = at;
            at += cosines[i] > least ? 1.0f : 0.0f;
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        for (size_t turn = 0; turn < (size_t)count; turn += size) {
            const size_t i = turn + item;
            if (i < (size_t)count && cosines[i] > least) {
                const int place = (int)staged[3 * i];
                own_rays[place] = first + (int)i;
                own_weights[place] = sharp ? cosine_power(cosines[i]) : cosines[i];
            }
        }
        length += all;
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    const int whole = (length + LIST_STEP - 1) / LIST_STEP * LIST_STEP;
    for (int i = length + (int)item; i < whole; i += (int)size) {
        own_rays[i] = 0;
        own_weights[i] = 0.0f;
    }
    if (item == 0)
        lengths[texel] = whole;
#endif
}

// The sums of a group.
#define GROUP_SUMS (LANES * TEXELS)

// Sums lie in local memory in rows of SUM_ROW, a probe beside the other: neighbours that read TEXELS
// rows in turns are on different ones of 32 banks.
#define SUM_ROW (LANES + 32 / TEXELS)

// Whether a probe's texels are written, and whether nothing is in them yet.
inline bool is_written(__global const float4 *probe_data, int probe, bool *fresh)
{
    if (probe >= PROBES)
        return false;
    const int state = probe_state(probe_data, probe);
    *fresh = !(state & PROBE_BLENDED);
    return state & PROBE_ACTIVE;
}

// Probe and texel that are written k-th, and where their sums lie.
inline bool writes_for(__global const float4 *probe_data, int texels, int k, int *probe, int *texel,
                       int *at, bool *fresh)
{
    const int tiles = (texels + TEXELS - 1) / TEXELS;
    *probe = (int)get_group_id(0) / tiles * LANES + k / TEXELS;
    *texel = (int)get_group_id(0) % tiles * TEXELS + k % TEXELS;
    *at = k % TEXELS * SUM_ROW + k / TEXELS;
    return *texel < texels && is_written(probe_data, *probe, fresh);
}

// The first probe and texel of a group.
#define group_probe(texels) ((int)get_group_id(0) / (((texels) + TEXELS - 1) / TEXELS) * LANES)
#define group_texel(texels) ((int)get_group_id(0) % (((texels) + TEXELS - 1) / TEXELS) * TEXELS)

#define PLANE (TEXELS * SUM_ROW)

// blend_irradiance: one work-group per LANES probes and TEXELS texels.
// sums: local, 3 * PLANE floats, unless VECTOR.
__kernel void blend_irradiance(VOLUME_PARAMS, __global const int *lengths,
                               __global const int *list_rays, __global const float *list_weights,
                               __global const float *rays, __global const float *backs,
                               __global const uint *frame_table, __global map_t *irradiance_maps,
                               __global float *variability, __global int *accepted,
                               __local float *sums)
{
    // Not ints: see srp/simt_projection.cl. Probes that are not active are summed and not written: what
    // is computed under a mask keeps such compilers from loading vectors.
    const size_t item = get_local_id(0);
    const int first = group_probe(IRRADIANCE_TEXELS), begin = group_texel(IRRADIANCE_TEXELS);
    const int end = min(begin + TEXELS, IRRADIANCE_TEXELS);
    __global const float *planes = rays + (size_t)first * (BLENDED * RAY_PLANES);
    for (size_t turn = 0; turn < LANES && first + (int)turn < PROBES; turn += TEAM) {
        const size_t lane = turn + item;
#if LANES % TEAM
        if (lane >= LANES)
            continue;
#endif
        for (int texel = begin; texel < end; ++texel) {
            __global const int *own_rays = list_rays + texel * LIST_LENGTH;
            __global const float *own_weights = list_weights + texel * LIST_LENGTH;
            const int length = lengths[texel];
            float red = 0.0f, green = 0.0f, blue = 0.0f, weights = 0.0f;
            float red1 = 0.0f, green1 = 0.0f, blue1 = 0.0f, weights1 = 0.0f;
            for (int i = 0; i < length; i += 2) {
                __global const float *row = planes + own_rays[i] * (RAY_PLANES * LANES);
                __global const float *row1 = planes + own_rays[i + 1] * (RAY_PLANES * LANES);
                const float w = own_weights[i], w1 = own_weights[i + 1];
                red += w * row[lane];
                green += w * row[LANES + lane];
                blue += w * row[2 * LANES + lane];
                weights += w * row[3 * LANES + lane];
                red1 += w1 * row1[lane];
                green1 += w1 * row1[LANES + lane];
                blue1 += w1 * row1[2 * LANES + lane];
                weights1 += w1 * row1[3 * LANES + lane];
            }
            const float scale = 0.5f / fmax(weights + weights1, LEAST_WEIGHTS);
            red = sample_of((red + red1) * scale);
            green = sample_of((green + green1) * scale);
            blue = sample_of((blue + blue1) * scale);
#if VECTOR
            const int probe = first + (int)lane;
            bool fresh;
            if (is_written(probe_data, probe, &fresh))
                update_irradiance(probe, texel, (float3)(red, green, blue), backs[probe], fresh,
                                  frame_table, irradiance_maps, variability, accepted);
#else
            __local float *own_sums = sums + (texel - begin) * SUM_ROW;
            own_sums[lane] = red;
            own_sums[PLANE + lane] = green;
            own_sums[2 * PLANE + lane] = blue;
#endif
        }
    }
#if !VECTOR
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int k = (int)item; k < GROUP_SUMS; k += TEAM) {
        int probe, texel, at;
        bool fresh;
        if (writes_for(probe_data, IRRADIANCE_TEXELS, k, &probe, &texel, &at, &fresh))
            update_irradiance(probe, texel,
                              (float3)(sums[at], sums[PLANE + at], sums[2 * PLANE + at]),
                              backs[probe], fresh, frame_table, irradiance_maps, variability,
                              accepted);
    }
#endif
}

// blend_distance: one work-group per LANES probes and TEXELS texels.
// sums: local, 3 * PLANE floats, unless VECTOR.
__kernel void blend_distance(VOLUME_PARAMS, __global const int *lengths,
                             __global const int *list_rays, __global const float *list_weights,
                             __global const float *rays, __global const uint *frame_table,
                             __global map_t *distance_maps, __local float *sums)
{
    // Not ints: see srp/simt_projection.cl.
    const size_t item = get_local_id(0);
    const int first = group_probe(DISTANCE_TEXELS), begin = group_texel(DISTANCE_TEXELS);
    const int end = min(begin + TEXELS, DISTANCE_TEXELS);
    __global const float *planes = rays + (size_t)first * (BLENDED * RAY_PLANES) + 4 * LANES;
    for (size_t turn = 0; turn < LANES && first + (int)turn < PROBES; turn += TEAM) {
        const size_t lane = turn + item;
#if LANES % TEAM
        if (lane >= LANES)
            continue;
#endif
        for (int texel = begin; texel < end; ++texel) {
            __global const int *own_rays = list_rays + texel * LIST_LENGTH;
            __global const float *own_weights = list_weights + texel * LIST_LENGTH;
            const int length = lengths[texel];
            float mean[LIST_STEP], square[LIST_STEP], weights = 0.0f;
#pragma unroll
            for (int k = 0; k < LIST_STEP; ++k)
                mean[k] = square[k] = 0.0f;
            for (int i = 0; i < length; i += LIST_STEP) {
#pragma unroll
                for (int k = 0; k < LIST_STEP; ++k) {
                    __global const float *row = planes + own_rays[i + k] * (RAY_PLANES * LANES);
                    const float w = own_weights[i + k];
                    mean[k] += w * row[lane];
                    square[k] += w * row[LANES + lane];
                    weights += w;
                }
            }
            const float sum = (mean[0] + mean[1]) + (mean[2] + mean[3]);
            const float squares = (square[0] + square[1]) + (square[2] + square[3]);
#if VECTOR
            const int probe = first + (int)lane;
            bool fresh;
            if (is_written(probe_data, probe, &fresh))
                update_distance(probe, texel, (float2)(sum, squares), weights, fresh, frame_table,
                                distance_maps);
#else
            __local float *own_sums = sums + (texel - begin) * SUM_ROW;
            own_sums[lane] = sum;
            own_sums[PLANE + lane] = squares;
            own_sums[2 * PLANE + lane] = weights;
#endif
        }
    }
#if !VECTOR
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int k = (int)item; k < GROUP_SUMS; k += TEAM) {
        int probe, texel, at;
        bool fresh;
        if (writes_for(probe_data, DISTANCE_TEXELS, k, &probe, &texel, &at, &fresh))
            update_distance(probe, texel, (float2)(sums[at], sums[PLANE + at]),
                            sums[2 * PLANE + at], fresh, frame_table, distance_maps);
    }
#endif
}
