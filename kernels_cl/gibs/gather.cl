// Irradiance at a point from the surfels of its grid cell (paper 004, sections 3.1.4 and 4.4).
//
// A surfel at p with normal m and radius r weighs, at x with normal n,
//   w = smoothstep(1 - d / r) * max(0, dot(n, m)) [* depth test]
//   d^2 = |t|^2 + (NORMAL_STRETCH h)^2,  h = dot(x - p, m),  t = x - p - h m
// (Lehtinen et al. 2008, "A Meshless Hierarchical Representation for Light Transport", the
// Mahalanobis metric as Barre-Brisebois et al. 2019 use it): 1 at the surfel, 0 from its radius on.
// Irradiance is the weighted mean, coverage the sum of the weights.
//
// published: work through the IDs of the cell's list, one surfel at a time.
// tuned: VEC surfels at a time from `packed`, which lies in list order.
#ifndef GIBENCH_GIBS_GATHER
#define GIBENCH_GIBS_GATHER

#include "common/vec_width.cl"
#include "gibs/frame.cl"
#include "gibs/grid.cl"
#include "gibs/depth.cl"

// mean: (3, CAPACITY) W/m2. moments: see gibs/depth.cl; read only with DEPTH.
#define GATHER_PARAMS                                                                         \
    __global const float *grid, __global const uint *starts, __global const uint *ends,       \
        __global const uint *ids, __global const float *packed,                               \
        __global const float *world_position, __global const float *world_normal,             \
        __global const float *radii, __global const float *mean, __global const float *moments
#define GATHER_ARGS                                                                            \
    grid, starts, ends, ids, packed, world_position, world_normal, radii, mean, moments

// The number of each lane.
#if VEC == 1
#define LANES 0.0f
#elif VEC == 2
#define LANES (float2)(0, 1)
#elif VEC == 4
#define LANES (float4)(0, 1, 2, 3)
#elif VEC == 8
#define LANES (float8)(0, 1, 2, 3, 4, 5, 6, 7)
#else
#define LANES (float16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
#endif

typedef struct {
    float3 irradiance; // W/m2; 0 where nothing covers
    float coverage;
} Gathered;

// seen: where not null, seen[id] = max(seen[id], stamp) for every surfel that counts.
inline Gathered gather(GATHER_PARAMS, float3 x, float3 n, __global uint *seen, uint stamp)
{
    const int cell = grid_cell(grid, x);
    float3 sum = (float3)(0.0f);
    float coverage = 0.0f;
#if PUBLISHED
    const uint start = starts[cell], end = ends[cell];
    for (uint e = start; e < end; ++e) {
        const uint id = ids[e];
        const float3 m = surfel_load3(world_normal, id);
        const float3 o = x - surfel_load3(world_position, id);
        const float h = dot(o, m);
        const float squared = dot(o, o) + (NORMAL_STRETCH * NORMAL_STRETCH - 1.0f) * h * h;
        const float t = fmax(1.0f - sqrt(squared) / radii[id], 0.0f);
        float w = t * t * (3.0f - 2.0f * t) * fmax(dot(n, m), 0.0f);
        if (w <= 0.0f)
            continue;
#if DEPTH
        w *= depth_visibility(moments, id, m, o);
#endif
        sum += w * surfel_load3(mean, id);
        coverage += w;
        if (seen)
            atomic_max(seen + id, stamp);
    }
#else
    const uint start = min(starts[cell], (uint)ENTRIES), end = min(starts[cell + 1], (uint)ENTRIES);
    vfloat sum_r = (vfloat)(0.0f), sum_g = sum_r, sum_b = sum_r, sum_w = sum_r;
    for (uint first = start; first < end; first += VEC) {
        __global const float *p = packed + first;
        const vfloat ox = x.x - vec_load(0, p);
        const vfloat oy = x.y - vec_load(0, p + PACKED_STRIDE);
        const vfloat oz = x.z - vec_load(0, p + 2 * PACKED_STRIDE);
        const vfloat mx = vec_load(0, p + 3 * PACKED_STRIDE);
        const vfloat my = vec_load(0, p + 4 * PACKED_STRIDE);
        const vfloat mz = vec_load(0, p + 5 * PACKED_STRIDE);
        const vfloat h = ox * mx + oy * my + oz * mz;
        const vfloat squared = ox * ox + oy * oy + oz * oz +
                               (NORMAL_STRETCH * NORMAL_STRETCH - 1.0f) * h * h;
        const vfloat inverse = vec_load(0, p + PACKED_RADIUS * PACKED_STRIDE);
        const vfloat t = fmax(1.0f - sqrt(squared) * inverse, (vfloat)(0.0f));
        vfloat w = t * t * (3.0f - 2.0f * t) *
                   fmax(n.x * mx + n.y * my + n.z * mz, (vfloat)(0.0f));
        // Lanes past the list's end belong to other cells.
        const float left = (float)(end - first);
        w = (LANES < left) ? w : (vfloat)(0.0f);
        if (!vec_any(w))
            continue;
#if DEPTH
        float weights[VEC];
        vec_store(w, 0, weights);
        for (uint lane = 0; lane < VEC; ++lane)
            if (weights[lane] > 0.0f) {
                const uint id = ids[first + lane];
                const float3 m = (float3)(p[3 * PACKED_STRIDE + lane], p[4 * PACKED_STRIDE + lane],
                                          p[5 * PACKED_STRIDE + lane]);
                const float3 o = x - (float3)(p[lane], p[PACKED_STRIDE + lane],
                                              p[2 * PACKED_STRIDE + lane]);
                weights[lane] *= depth_visibility(moments, id, m, o);
            }
        w = vec_load(0, weights);
#endif
        p += PACKED_IRRADIANCE * PACKED_STRIDE;
        sum_r += w * vec_load(0, p);
        sum_g += w * vec_load(0, p + PACKED_STRIDE);
        sum_b += w * vec_load(0, p + 2 * PACKED_STRIDE);
        sum_w += w;
        if (seen) {
            float marked[VEC];
            vec_store(w, 0, marked);
            for (uint lane = 0; lane < VEC; ++lane)
                if (marked[lane] > 0.0f)
                    atomic_max(seen + ids[first + lane], stamp);
        }
    }
    sum = (float3)(vec_sum(sum_r), vec_sum(sum_g), vec_sum(sum_b));
    coverage = vec_sum(sum_w);
#endif
    Gathered g;
    g.coverage = coverage;
    g.irradiance = coverage > 0.0f ? sum / coverage : (float3)(0.0f);
    return g;
}

#endif
