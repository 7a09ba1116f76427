// Irradiance at a point from the surfels of its grid cell (Ekberg 2022, sections 3.1.4 and 4.4).
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
#include "parts/surfel_grid.cl"
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

// Unaligned loads, max(x, 0) and sums over lanes without builtin calls: around a call PoCL 3 spills
// every vector.
#if VEC == 1
#define vec_at(p) (*(p))
#elif defined(__clang__)
typedef vfloat vfloat_unaligned __attribute__((aligned(4)));
#define vec_at(p) ((vfloat)*(__global const vfloat_unaligned *)(p))
#else
#define vec_at(p) vec_load(0, p)
#endif

inline vfloat vec_max0(vfloat x)
{
    return x > 0.0f ? x : (vfloat)(0.0f);
}

// Sum of all lanes, pairwise.
inline float lanes_sum(vfloat v)
{
#if VEC == 1
    return v;
#else
#if VEC == 16
    // Through memory rather than v.lo and v.hi, which Oclgrind takes for uninitialised at this width.
    const float8 *half_of = (const float8 *)&v;
    const float8 a = half_of[0] + half_of[1];
#elif VEC == 8
    const float8 a = v;
#endif
#if VEC >= 8
    const float4 b = a.lo + a.hi;
#elif VEC == 4
    const float4 b = v;
#endif
#if VEC >= 4
    const float2 c = b.lo + b.hi;
#else
    const float2 c = v;
#endif
    return c.x + c.y;
#endif
}

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
        const vfloat ox = x.x - vec_at(p);
        const vfloat oy = x.y - vec_at(p + PACKED_STRIDE);
        const vfloat oz = x.z - vec_at(p + 2 * PACKED_STRIDE);
        const vfloat mx = vec_at(p + 3 * PACKED_STRIDE);
        const vfloat my = vec_at(p + 4 * PACKED_STRIDE);
        const vfloat mz = vec_at(p + 5 * PACKED_STRIDE);
        const vfloat h = ox * mx + oy * my + oz * mz;
        const vfloat away = ox * ox + oy * oy + oz * oz;
        const vfloat squared = away + (NORMAL_STRETCH * NORMAL_STRETCH - 1.0f) * h * h;
        const vfloat inverse = vec_at(p + PACKED_RADIUS * PACKED_STRIDE);
        const vfloat t = vec_max0(1.0f - sqrt(squared) * inverse);
        vfloat w = t * t * (3.0f - 2.0f * t) *
                   vec_max0(n.x * mx + n.y * my + n.z * mz);
        // Lanes past the list's end belong to other cells.
        const float left = (float)(end - first);
        w = (LANES < left) ? w : (vfloat)(0.0f);
        if (!vec_any(w))
            continue;
#if DEPTH
        // A point nearer than all mean depths passes for certain.
        const vfloat nearest = vec_at(p + PACKED_NEAREST * PACKED_STRIDE);
        const vfloat doubtful = away > nearest * nearest ? w : (vfloat)(0.0f);
        if (vec_any(doubtful)) {
            float weights[VEC], tested[VEC];
            vec_store(w, 0, weights);
            vec_store(doubtful, 0, tested);
            for (uint lane = 0; lane < VEC; ++lane) {
                if (tested[lane] <= 0.0f)
                    continue;
                const uint id = ids[first + lane];
                const float3 m = (float3)(p[3 * PACKED_STRIDE + lane], p[4 * PACKED_STRIDE + lane],
                                          p[5 * PACKED_STRIDE + lane]);
                const float3 o = x - (float3)(p[lane], p[PACKED_STRIDE + lane],
                                              p[2 * PACKED_STRIDE + lane]);
                weights[lane] *= depth_visibility(moments, id, m, o);
            }
            w = vec_load(0, weights);
        }
#endif
        p += PACKED_IRRADIANCE * PACKED_STRIDE;
        sum_r += w * vec_at(p);
        sum_g += w * vec_at(p + PACKED_STRIDE);
        sum_b += w * vec_at(p + 2 * PACKED_STRIDE);
        sum_w += w;
        if (seen) {
            float marked[VEC];
            vec_store(w, 0, marked);
            for (uint lane = 0; lane < VEC; ++lane)
                if (marked[lane] > 0.0f)
                    atomic_max(seen + ids[first + lane], stamp);
        }
    }
    sum = (float3)(lanes_sum(sum_r), lanes_sum(sum_g), lanes_sum(sum_b));
    coverage = lanes_sum(sum_w);
#endif
    Gathered g;
    g.coverage = coverage;
    g.irradiance = coverage > 0.0f ? sum / coverage : (float3)(0.0f);
    return g;
}

#endif
