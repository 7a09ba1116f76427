// The irradiance pass: rays shared out, traced, and taken in by the estimators.
//
// Built with CAPACITY, ENTRIES, PUBLISHED, VEC, the grid's macros, DEPTH (depth moments), GUIDING
// (ray guiding), FLOORED (estimator) and BY_RAYS (surfels are placed where rays hit), 0 or 1.
#include "common/bvh.cl"
#include "common/environment.cl"
#include "common/lights.cl"
#include "common/material.cl"
#include "common/sampling.cl"
#include "common/shade.cl"
#include "gibs/gather.cl"
#include "gibs/estimator.cl"
#include "gibs/bare.cl"

// Share of a surfel's rays it asks for while it is out of sight; ours.
#define HIDDEN_SHARE 0.25f
// What a surfel asks for is CONSISTENT_SHARE + its inconsistency, at most MOST_INCONSISTENT; ours.
#define CONSISTENT_SHARE 0.125f
#define MOST_INCONSISTENT 4.0f
#define REQUEST_UNITS 256.0f

// Weight of a new sample in the guide and, once they have had many, in the depth moments; ours.
#define GUIDE_RATE 0.1f
#define MOMENT_RATE 0.05f

// request_rays: one work-item per surfel alive; what share of the frame's rays it asks for.
__kernel void request_rays(__global const uint *frame, __global const uint *alive_ids,
                           __global const float *estimator, __global const uint *seen,
                           __global uint *requests)
{
    const uint i = get_global_id(0);
    if (i >= frame[SURFELS_ALIVE])
        return;
    const uint id = alive_ids[i];
    const float inconsistency = estimator[ROW_INCONSISTENCY * CAPACITY + id];
    const bool visible = frame[FRAME_NUMBER] - seen[id] <= VISIBLE_FRAMES;
    const float share = (visible ? 1.0f : HIDDEN_SHARE) *
                        (CONSISTENT_SHARE + fmin(inconsistency, MOST_INCONSISTENT));
    requests[i] = max((uint)(share * REQUEST_UNITS), 1u);
}

// The rays before those of the surfel whose requests start at `before`, of `total`.
inline uint rays_before(__global const uint *frame, uint before, uint total)
{
    const uint phase = random_words(frame[FRAME_SEED], frame[FRAME_NUMBER], 0x5eedu).x % total;
    return (uint)(((ulong)before * frame[FRAME_RAYS] + phase) / total);
}

// assign_rays: one work-item per surfel alive. `before` is the exclusive prefix sum of the requests.
// Rays go to surfels in proportion to their requests, scaled to the budget exactly; what does not
// come out whole is rounded by one random phase per frame (systematic sampling), so that a surfel
// that asks for half a ray gets one every other frame.
// ray_first: (alive + 1,) first ray of each surfel. ray_owner: the surfel (its place in alive_ids)
// of each ray.
__kernel void assign_rays(__global const uint *frame, __global const uint *before,
                          __global uint *ray_first, __global uint *ray_owner)
{
    const uint i = get_global_id(0), alive = frame[SURFELS_ALIVE];
    if (i >= alive)
        return;
    const uint first = rays_before(frame, before[i], before[alive]);
    const uint last = rays_before(frame, before[i + 1], before[alive]);
    ray_first[i] = first;
    if (i == alive - 1)
        ray_first[alive] = last;
    for (uint ray = first; ray < last; ++ray)
        ray_owner[ray] = i;
}

#if GUIDING
// A texel of the guide with chance P = GUIDE_UNIFORM / 16 + (1 - GUIDE_UNIFORM) g / sum(g).
// A guide that knows too little gives all texels the same chance.
// *u is rescaled to what is left of it; returns 16 P.
inline float guide_texel(__global const float *guide, bool knows, float *u, int *texel)
{
    float sum = 0.0f;
    for (int i = 0; knows && i < HEMISPHERE_TEXELS; ++i)
        sum += guide[i];
    const float scale = sum > 0.0f ? (1.0f - GUIDE_UNIFORM) / sum : 0.0f;
    const float floor_chance = (sum > 0.0f ? GUIDE_UNIFORM : 1.0f) / HEMISPHERE_TEXELS;
    float below = 0.0f, chance = 0.0f;
    int i = 0;
    for (;; ++i) {
        chance = floor_chance + scale * guide[i];
        if (*u < below + chance || i == HEMISPHERE_TEXELS - 1)
            break;
        below += chance;
    }
    *u = clamp((*u - below) / chance, 0.0f, 0.999999f);
    *texel = i;
    return chance * HEMISPHERE_TEXELS;
}
#endif

// trace_rays: one work-item per ray. Casts it from its surfel in a cosine-distributed direction (or
// by the guide) and finds what comes back along it: emission, direct light and the surfels' own
// irradiance of the last frame at the hit (endless bounces), or the environment.
// ray_light: (rays,) radiance, W/m2/sr and distance, m.
// ray_choice: (rays,) the factor by which the direction is under-represented, and its texel.
__kernel void trace_rays(__global const uint *frame, __global const uint *alive_ids,
                         __global const uint *births, __global const uint *ray_first,
                         __global const uint *ray_owner, __global const float *estimator,
                         __global const float *guides, BVH_PARAMS, SURFACE_PARAMS, LIGHT_PARAMS,
                         ENVIRONMENT_PARAMS, GATHER_PARAMS,
                         BARE_PARAMS __global float4 *ray_light, __global float2 *ray_choice)
{
    const uint ray = get_global_id(0);
    if (ray >= frame[FRAME_RAYS])
        return;
    const uint i = ray_owner[ray];
    const uint id = alive_ids[i];
    const uint3 random = random_words(births[id] ^ frame[FRAME_SEED], frame[FRAME_NUMBER],
                                      ray - ray_first[i]);
    float across = unit_float(random.x);
    const float up = unit_float(random.y);
    float factor = 1.0f;
#if GUIDING
    int texel;
    const bool knows = estimator[ROW_RAYS * CAPACITY + id] >= GUIDE_FIRST_RAYS;
    factor = 1.0f / guide_texel(guides + (size_t)id * HEMISPHERE_TEXELS, knows, &across, &texel);
    // `across` chose the texel and what is left of it serves within it.
    const float2 square =
        ((float2)(texel % HEMISPHERE_SIDE, texel / HEMISPHERE_SIDE) + (float2)(across, up)) *
            (2.0f / HEMISPHERE_SIDE) -
        1.0f;
#else
    const float2 square = (float2)(across, up) * 2.0f - 1.0f;
    const int texel = hemisphere_texel(square);
#endif
    const float3 normal = surfel_load3(world_normal, id);
    const float3 direction = hemisphere_direction(normal, square);
    const float3 origin = offset_from_surface(surfel_load3(world_position, id), normal);
    const Hit hit = bvh_closest(BVH_ARGS, origin, direction, INFINITY);
    float3 radiance = (float3)(0.0f);
    if (hit.triangle < 0) {
        radiance = environment_radiance(ENVIRONMENT_ARGS, direction);
    } else {
        const Surface s = surface_at(SURFACE_ARGS, hit);
        if (dot(s.geometric_normal, direction) < 0.0f) {
            const Gathered g = gather(GATHER_ARGS, s.position, s.normal, (__global uint *)0, 0);
            const float3 direct = direct_irradiance(BVH_ARGS, LIGHT_ARGS,
                                                    back_along_ray(s.position, direction), s.normal,
                                                    s.geometric_normal);
            radiance = with_reflected(s.emission, s.albedo, direct + g.irradiance);
#if BY_RAYS
            // Not in a crack, where surfels see no further than across it and cover nothing.
            if (coverage_steps(g.coverage) < bare && hit.t > radii[id]) {
                ray_hit[ray] = (float4)(as_float(hit.triangle), hit.u, hit.v, 0.0f);
                atomic_min(cell_ray + grid_cell(grid, s.position), ray_key(frame, ray));
            }
#endif
        }
    }
    ray_light[ray] = (float4)(radiance, hit.t);
    ray_choice[ray] = (float2)(factor, (float)texel);
}

// update_surfels: one work-item per surfel alive; its estimator takes in its rays one after the
// other, its guide and its depth moments learn from them. nearest: the least of its mean depths.
// A ray beyond the surfel's diameter, or one that meets nothing, counts as the diameter: "inside the
// diameter" (Ekberg 2022, section 3.1.4) bounds what the test can ask for.
__kernel void update_surfels(__global const uint *frame, __global const uint *alive_ids,
                             __global const uint *ray_first, __global const float4 *ray_light,
                             __global const float2 *ray_choice, __global const float *radii,
                             __global float *estimator, __global float *moments,
                             __global float *nearest, __global float *guides)
{
    const uint i = get_global_id(0);
    if (i >= frame[SURFELS_ALIVE])
        return;
    const uint id = alive_ids[i];
    Estimator e = estimator_load(estimator, id);
    const uint last = ray_first[i + 1];
    for (uint ray = ray_first[i]; ray < last; ++ray) {
        const float4 light = ray_light[ray];
        const float2 choice = ray_choice[ray];
        estimator_add(&e, PI_F * choice.x * light.xyz);
#if DEPTH
        __global float *m = moments + (size_t)id * MOMENT_FLOATS + (int)choice.y;
        const float distance = fmin(light.w, 2.0f * radii[id]);
        // A plain mean at first, a moving one in the end.
        const float rays = m[2 * HEMISPHERE_TEXELS] + 1.0f;
        const float rate = fmax(1.0f / rays, MOMENT_RATE);
        m[0] += rate * (distance - m[0]);
        m[HEMISPHERE_TEXELS] += rate * (distance * distance - m[HEMISPHERE_TEXELS]);
        m[2 * HEMISPHERE_TEXELS] = fmin(rays, 1.0f / MOMENT_RATE);
#endif
#if GUIDING
        __global float *g = guides + (size_t)id * HEMISPHERE_TEXELS + (int)choice.y;
        g[0] += GUIDE_RATE * (luma(light.xyz) - g[0]);
#endif
    }
    estimator_store(estimator, id, e);
#if DEPTH
    float least = INFINITY;
    for (int t = 0; t < HEMISPHERE_TEXELS; ++t)
        least = fmin(least, moments[(size_t)id * MOMENT_FLOATS + t]);
    nearest[id] = least;
#endif
}
