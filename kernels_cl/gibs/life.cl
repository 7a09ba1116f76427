// Coverage, placement and recycling: how surfels come and go (Ekberg 2022, sections 3.1.1 and 4.5).
//
// Built with CAPACITY, ENTRIES, PUBLISHED, VEC, DEPTH, GUIDING, FLOORED, BY_RAYS and the grid's
// macros.
// IDs that are free lie on a stack, free_ids[0] to free_ids[counters[COUNT_FREE] - 1]; alive_ids
// lists the others. Both change by prefix sums over the tiles and the surfels instead of by an
// atomic per surfel, so that the same seed gives the same IDs.
#include "parts/scan.cl"
#include "gibs/gather.cl"
#include "common/material.cl"
#include "gibs/estimator.cl"
#include "gibs/bare.cl"

#define TILE_PIXEL_COUNT (PLACEMENT_TILE * PLACEMENT_TILE)

// coverage: one work-group per tile of PLACEMENT_TILE x PLACEMENT_TILE pixels. Finds the tile's least
// covered pixel by one atomic minimum over words that hold the coverage above the pixel's number in
// the tile.
// least: (tiles,) that word; NO_PIXEL where the tile shows no surface.
__kernel void coverage(__global const float4 *g_position, __global const float4 *indirect,
                       int width, int height, __global uint *least)
{
    __local uint smallest;
    const int tiles_across = (width + PLACEMENT_TILE - 1) / PLACEMENT_TILE;
    const int tile = get_group_id(0);
    const int left = tile % tiles_across * PLACEMENT_TILE;
    const int top = tile / tiles_across * PLACEMENT_TILE;
    if (get_local_id(0) == 0)
        smallest = NO_PIXEL;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (uint k = get_local_id(0); k < TILE_PIXEL_COUNT; k += get_local_size(0)) {
        const int x = left + k % PLACEMENT_TILE, y = top + k / PLACEMENT_TILE;
        if (x >= width || y >= height)
            continue;
        const int at = y * width + x;
        if (as_int(g_position[at].w) != 0)
            atomic_min(&smallest, coverage_steps(indirect[at].w) << 8 | k);
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (get_local_id(0) == 0)
        least[tile] = smallest;
}

// What placement writes of a surfel. transforms: (objects, 12) object to world, rigid. births: a
// number for each surfel's random choices.
#define PLACED_PARAMS                                                                         \
    __global const float *transforms, __global uint *counters, __global const uint *free_ids, \
        __global uint *alive_ids, __global int *object_ids, __global float *local_position,   \
        __global float *local_normal, __global uint *births, __global uint *seen,             \
        __global float *estimator, __global float *moments, __global float *nearest,          \
        __global float *guides
#define PLACED_ARGS                                                                          \
    transforms, counters, free_ids, alive_ids, object_ids, local_position, local_normal, births, \
        seen, estimator, moments, nearest, guides

// Places surfel `id` on an object's surface (numbers from 1), as the one at `place` in alive_ids.
inline void place_surfel(__global const uint *frame, PLACED_PARAMS, uint id, uint place, int object,
                         float3 position, float3 n, uint birth)
{
    // The inverse: the rotation's rows are its columns.
    __global const float *m = transforms + 12 * (object - 1);
    const float3 mx = (float3)(m[0], m[1], m[2]), my = (float3)(m[4], m[5], m[6]);
    const float3 mz = (float3)(m[8], m[9], m[10]);
    const float3 d = position - (float3)(m[3], m[7], m[11]);
    alive_ids[place] = id;
    object_ids[id] = object;
    surfel_store3(local_position, id, mx * d.x + my * d.y + mz * d.z);
    surfel_store3(local_normal, id, mx * n.x + my * n.y + mz * n.z);
    births[id] = birth;
    seen[id] = frame[FRAME_NUMBER];
    estimator_store(estimator, id, estimator_new());
#if DEPTH
    // Nothing is known to be in the way.
    const float away = length(position - surfel_camera(frame));
    const float reach = 2.0f * surfel_radius(frame, away);
    for (int t = 0; t < HEMISPHERE_TEXELS; ++t) {
        moments[(size_t)id * MOMENT_FLOATS + t] = reach;
        moments[(size_t)id * MOMENT_FLOATS + HEMISPHERE_TEXELS + t] = reach * reach;
        moments[(size_t)id * MOMENT_FLOATS + 2 * HEMISPHERE_TEXELS + t] = 0.0f;
    }
    nearest[id] = reach;
#endif
#if GUIDING
    for (int t = 0; t < HEMISPHERE_TEXELS; ++t)
        guides[(size_t)id * HEMISPHERE_TEXELS + t] = 0.0f;
#endif
}

// The place of what each work-item wants among all that the group wants, after `placed` that were
// wanted before. Every work-item must call it.
inline uint rank_in_group(bool wanted, uint placed, __local uint *partial)
{
    return placed + scan_group(wanted ? 1u : 0u, partial) - (wanted ? 1u : 0u);
}

// How many the whole group has wanted so far: the last item's rank and its own. Every work-item must
// call it.
inline uint wanted_so_far(bool wanted, uint rank, __local uint *partial)
{
    barrier(CLK_LOCAL_MEM_FENCE);
    if (get_local_id(0) == get_local_size(0) - 1)
        partial[0] = rank + (wanted ? 1u : 0u);
    barrier(CLK_LOCAL_MEM_FENCE);
    const uint total = partial[0];
    barrier(CLK_LOCAL_MEM_FENCE);
    return total;
}

// placement: one work-group for all tiles. Where a tile's least coverage is under the threshold (in
// steps), a surfel is placed on that pixel with a chance (of 2^32), as long as IDs are free.
__kernel void placement(__global const uint *frame, __global const uint *least, int width,
                        int height, uint threshold, uint chance, __global const float4 *g_position,
                        __global const float4 *g_normal, PLACED_PARAMS, __local uint *partial)
{
    const uint item = get_local_id(0), size = get_local_size(0);
    const int tiles_across = (width + PLACEMENT_TILE - 1) / PLACEMENT_TILE;
    const int tiles_down = (height + PLACEMENT_TILE - 1) / PLACEMENT_TILE;
    const uint tiles = tiles_across * tiles_down;
    const uint alive = counters[COUNT_ALIVE], free = counters[COUNT_FREE];
    uint placed = 0;
    for (uint first = 0; first < tiles; first += size) {
        const uint tile = first + item;
        const uint word = tile < tiles ? least[tile] : NO_PIXEL;
        const uint3 random = random_words(frame[FRAME_SEED] ^ 0x9e3779b9u, frame[FRAME_NUMBER], tile);
        const bool wanted = word != NO_PIXEL && word >> 8 < threshold && random.x < chance;
        const uint rank = rank_in_group(wanted, placed, partial);
        if (wanted && rank < free) {
            const int x = tile % tiles_across * PLACEMENT_TILE + (word & 0xffu) % PLACEMENT_TILE;
            const int y = tile / tiles_across * PLACEMENT_TILE + (word & 0xffu) / PLACEMENT_TILE;
            const float4 p = g_position[y * width + x];
            place_surfel(frame, PLACED_ARGS, free_ids[free - 1 - rank], alive + rank, as_int(p.w),
                         p.xyz, g_normal[y * width + x].xyz, random.y);
        }
        placed = wanted_so_far(wanted, rank, partial);
    }
    barrier(CLK_GLOBAL_MEM_FENCE);
    if (item == 0) {
        placed = min(placed, free);
        counters[COUNT_ALIVE] = alive + placed;
        counters[COUNT_FREE] = free - placed;
        counters[COUNT_PLACED] = placed;
    }
}

#if BY_RAYS
// placement_by_rays: one work-group for all cells; after placement. In a cell where rays hit bare
// surface a surfel is placed on one of the hits with a chance (of 2^32), as long as IDs are free and
// fewer than most_alive are taken: the rest is the camera's. Empties cell_ray.
// object_of: (triangles,) object numbers from 0.
__kernel void placement_by_rays(__global const uint *frame, __global uint *cell_ray,
                                __global const float4 *ray_hit, SHAPE_PARAMS,
                                __global const int *object_of, uint chance, uint most_alive,
                                PLACED_PARAMS, __local uint *partial)
{
    const uint item = get_local_id(0), size = get_local_size(0);
    const uint alive = counters[COUNT_ALIVE], free = counters[COUNT_FREE];
    const uint room = min(free, most_alive - min(alive, most_alive));
    uint placed = 0;
    for (uint first = 0; first < GRID_CELLS; first += size) {
        const uint cell = first + item;
        const uint key = cell < GRID_CELLS ? cell_ray[cell] : NO_RAY;
        const uint3 random = random_words(frame[FRAME_SEED] ^ 0xc2b2ae35u, frame[FRAME_NUMBER], cell);
        const bool wanted = key != NO_RAY && random.x < chance;
        const uint rank = rank_in_group(wanted, placed, partial);
        if (key != NO_RAY)
            cell_ray[cell] = NO_RAY;
        if (wanted && rank < room) {
            const float4 kept = ray_hit[ray_of_key(frame, key)];
            const Hit hit = {0.0f, kept.y, kept.z, as_int(kept.x)};
            const Surface s = surface_shape(SHAPE_ARGS, hit);
            place_surfel(frame, PLACED_ARGS, free_ids[free - 1 - rank], alive + rank,
                         object_of[hit.triangle] + 1, s.position, s.normal, random.y);
        }
        placed = wanted_so_far(wanted, rank, partial);
    }
    barrier(CLK_GLOBAL_MEM_FENCE);
    if (item == 0) {
        placed = min(placed, room);
        counters[COUNT_ALIVE] = alive + placed;
        counters[COUNT_FREE] = free - placed;
        counters[COUNT_PLACED] += placed;
    }
}
#endif

// recycling_choose: one work-item per surfel, those placed in this frame included; keep[i] = 0 where
// it goes. Ekberg 2022, section 3.1.1.2: by the number of surfels, the time since a surfel was last
// seen, its distance and the coverage around it, with a chance.
//   too much coverage at the surfel itself: it goes with the chance;
//   else with the chance times pressure times the larger of
//     frames unseen / unseen_frames and, while it is unseen, distance / far_distance (at most 1),
//   where pressure grows from 0 at a filling of `pressure_from` to 1 where all IDs are taken.
// A surfel seen in the last 16 frames is only ever recycled for coverage.
__kernel void recycling_choose(__global const uint *frame, GATHER_PARAMS,
                               __global const uint *alive_ids, __global const uint *counters,
                               __global const uint *seen, __global const uint *births, float chance,
                               float unseen_frames, float far_distance, float pressure_from,
                               float most_coverage, __global uint *keep)
{
    const uint i = get_global_id(0);
    if (i >= counters[COUNT_ALIVE])
        return;
    bool stays = true;
    const uint id = alive_ids[i];
    const float draw = unit_float(random_words(births[id] ^ frame[FRAME_SEED], frame[FRAME_NUMBER],
                                               0xdeadu).x);
    if (i < frame[SURFELS_ALIVE] && draw < chance) {
        const float3 position = surfel_load3(world_position, id);
        const uint unseen = frame[FRAME_NUMBER] - seen[id];
        if (unseen > 16) {
            const float filling = (float)counters[COUNT_ALIVE] / CAPACITY;
            const float pressure = smoothstep(pressure_from, 1.0f, filling);
            const float away = distance(position, surfel_camera(frame)) / far_distance;
            const float age = unseen / unseen_frames;
            stays = draw >= chance * pressure * fmin(fmax(age, away), 1.0f);
        }
        if (stays) {
            const Gathered g = gather(GATHER_ARGS, position, surfel_load3(world_normal, id),
                                      (__global uint *)0, 0);
            stays = g.coverage <= most_coverage;
        }
    }
    keep[i] = stays;
}

// recycling_move: one work-item per surfel; `before` is the exclusive prefix sum of keep. Survivors
// close ranks in `survivors`; the IDs of the others go onto the stack, their object becomes 0.
__kernel void recycling_move(__global const uint *alive_ids, __global uint *counters,
                             __global const uint *keep, __global const uint *before,
                             __global uint *survivors, __global uint *free_ids,
                             __global int *object_ids)
{
    const uint i = get_global_id(0), alive = counters[COUNT_ALIVE];
    if (i == 0) {
        counters[COUNT_SURVIVORS] = alive ? before[alive] : 0;
        counters[COUNT_RECYCLED] = alive ? alive - before[alive] : 0;
    }
    if (i >= alive)
        return;
    const uint id = alive_ids[i];
    if (keep[i]) {
        survivors[before[i]] = id;
    } else {
        free_ids[counters[COUNT_FREE] + i - before[i]] = id;
        object_ids[id] = 0;
    }
}

// recycling_commit: one work-item per surfel; survivors become the list of the living.
__kernel void recycling_commit(__global const uint *survivors, __global uint *alive_ids,
                               __global uint *counters)
{
    const uint i = get_global_id(0);
    if (i < counters[COUNT_SURVIVORS])
        alive_ids[i] = survivors[i];
    if (i == 0) {
        counters[COUNT_ALIVE] = counters[COUNT_SURVIVORS];
        counters[COUNT_FREE] += counters[COUNT_RECYCLED];
    }
}
