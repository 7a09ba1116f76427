// Sorting surfels into the grid: count, (prefix sum: parts/scan.cl,) finalise.
// Ekberg 2022, section 4.2. Built with CAPACITY (surfels), ENTRIES (room in the lists), the grid's
// macros (parts/surfel_grid.cl), PUBLISHED and BY_ENTRY.
//
// published: `ends` holds the counts, is scanned into `starts`, is set to it, and becomes the lists'
//   ends while finalise writes. List of cell c: ids[starts[c]] to ids[ends[c] - 1], in any order.
// tuned: `counts` is scanned into `starts` (one more word: the total) and counts back to zero while
//   finalise writes, so that nothing is cleared. List of cell c: ids[starts[c]] to
//   ids[starts[c + 1] - 1], ascending; beside it `packed` holds what a lookup reads, in list order.
//   BY_ENTRY 1, in the layout `simt`: finalise writes entries of two words, surfel and cell, which
//   parts/simt_surfel_lists.cl brings into order; else sort_lists and pack_lists do.
// An entry that finds no room is dropped; the total tells.
#include "common/rigid.cl"
#include "parts/surfel_grid.cl"
#include "parts/surfels.cl"

// clear_counts: one work-item per cell (published only).
__kernel void clear_counts(__global uint *ends)
{
    const int cell = get_global_id(0);
    if (cell < GRID_CELLS)
        ends[cell] = 0;
}

// transform_and_count: one work-item per surfel alive. Moves the surfel with its object (transforms:
// 3 x 4, row-major), sets its radius so that it keeps its size on screen, and counts it into every
// cell it goes into. object_ids: 0 is reserved for a surfel that is not placed.
__kernel void transform_and_count(__global const uint *frame, __global const float *grid,
                                  __global const uint *alive_ids, __global const int *object_ids,
                                  __global const float *transforms,
                                  __global const float *local_position,
                                  __global const float *local_normal,
                                  __global float *world_position, __global float *world_normal,
                                  __global float *radii, __global uint *counts)
{
    const uint i = get_global_id(0);
    if (i >= frame[SURFELS_ALIVE])
        return;
    const uint id = alive_ids[i];
    const Rigid object = rigid_load(transforms, object_ids[id] - 1);
    const float3 position = rigid_point(&object, surfel_load3(local_position, id));
    const float3 normal = rigid_direction(&object, surfel_load3(local_normal, id));
    const float radius = surfel_radius(frame, length(position - surfel_camera(frame)));
    surfel_store3(world_position, id, position);
    surfel_store3(world_normal, id, normal);
    radii[id] = radius;
    GRID_FOR_EACH(grid, position, normal, radius, cell, atomic_inc(counts + cell))
}

// begin_lists: one work-item per cell (published only); ends = starts.
__kernel void begin_lists(__global const uint *starts, __global uint *ends)
{
    const int cell = get_global_id(0);
    if (cell < GRID_CELLS)
        ends[cell] = starts[cell];
}

inline void add_to_list(__global const uint *starts, __global uint *cursors, __global uint *ids,
                        int cell, uint id)
{
#if PUBLISHED
    const uint slot = atomic_inc(cursors + cell);
#else
    const uint slot = starts[cell] + atomic_dec(cursors + cell) - 1;
#endif
    if (slot < ENTRIES) {
#if BY_ENTRY
        ((__global uint2 *)ids)[slot] = (uint2)(id, (uint)cell);
#else
        ids[slot] = id;
#endif
    }
}

// finalise: one work-item per surfel alive; writes its ID into the list of every cell it goes into.
// cursors: `ends` as published, `counts` in the tuned variant. ids: BY_ENTRY, the entries.
__kernel void finalise(__global const uint *frame, __global const float *grid,
                       __global const uint *alive_ids, __global const float *world_position,
                       __global const float *world_normal, __global const float *radii,
                       __global const uint *starts, __global uint *cursors, __global uint *ids)
{
    const uint i = get_global_id(0);
    if (i >= frame[SURFELS_ALIVE])
        return;
    const uint id = alive_ids[i];
    const float3 position = surfel_load3(world_position, id);
    const float3 normal = surfel_load3(world_normal, id);
    GRID_FOR_EACH(grid, position, normal, radii[id], cell, add_to_list(starts, cursors, ids, cell, id))
}

inline void sift_down(__global uint *ids, uint root, uint count)
{
    const uint value = ids[root];
    while (2 * root + 1 < count) {
        uint child = 2 * root + 1;
        if (child + 1 < count && ids[child + 1] > ids[child])
            child++;
        if (ids[child] <= value)
            break;
        ids[root] = ids[child];
        root = child;
    }
    ids[root] = value;
}

// Ascending, in place: insertion for the usual short lists, heap sort for long ones.
inline void sort_ids(__global uint *ids, uint count)
{
    if (count <= 64) {
        for (uint i = 1; i < count; ++i) {
            const uint value = ids[i];
            uint at = i;
            while (at > 0 && ids[at - 1] > value) {
                ids[at] = ids[at - 1];
                at--;
            }
            ids[at] = value;
        }
        return;
    }
    for (uint root = count / 2; root-- > 0;)
        sift_down(ids, root, count);
    for (uint last = count - 1; last > 0; --last) {
        const uint largest = ids[0];
        ids[0] = ids[last];
        ids[last] = largest;
        sift_down(ids, 0, last);
    }
}

// sort_lists: one work-item per cell (tuned, wide). Puts the cell's IDs in ascending order, so that
// sums over them do not depend on the order in which work-items ran.
__kernel void sort_lists(__global const uint *starts, __global uint *ids)
{
    const int cell = get_global_id(0);
    if (cell >= GRID_CELLS)
        return;
    const uint start = min(starts[cell], (uint)ENTRIES), end = min(starts[cell + 1], (uint)ENTRIES);
    sort_ids(ids + start, end - start);
}

// pack_lists: one work-item per cell (tuned, wide). Copies what a lookup reads of the cell's surfels
// into list order. mean: (3, CAPACITY) irradiance, W/m2. nearest:
// (CAPACITY,) least mean depth, m.
__kernel void pack_lists(__global const uint *starts, __global const uint *ids,
                         __global const float *world_position, __global const float *world_normal,
                         __global const float *radii, __global const float *mean,
                         __global const float *nearest, __global float *packed)
{
    const int cell = get_global_id(0);
    if (cell >= GRID_CELLS)
        return;
    const uint start = min(starts[cell], (uint)ENTRIES), end = min(starts[cell + 1], (uint)ENTRIES);
    for (uint e = start; e < end; ++e) {
        const uint id = ids[e];
        for (int c = 0; c < 3; ++c) {
            packed[c * PACKED_STRIDE + e] = world_position[c * CAPACITY + id];
            packed[(3 + c) * PACKED_STRIDE + e] = world_normal[c * CAPACITY + id];
            packed[(PACKED_IRRADIANCE + c) * PACKED_STRIDE + e] = mean[c * CAPACITY + id];
        }
        packed[PACKED_RADIUS * PACKED_STRIDE + e] = 1.0f / radii[id];
        packed[PACKED_NEAREST * PACKED_STRIDE + e] = nearest[id];
    }
}

// pack_irradiance: one work-item per cell (tuned, wide); refreshes in `packed` what the irradiance
// pass has changed.
__kernel void pack_irradiance(__global const uint *starts, __global const uint *ids,
                              __global const float *mean, __global const float *nearest,
                              __global float *packed)
{
    const int cell = get_global_id(0);
    if (cell >= GRID_CELLS)
        return;
    const uint start = min(starts[cell], (uint)ENTRIES), end = min(starts[cell + 1], (uint)ENTRIES);
    for (uint e = start; e < end; ++e) {
        const uint id = ids[e];
        for (int c = 0; c < 3; ++c)
            packed[(PACKED_IRRADIANCE + c) * PACKED_STRIDE + e] = mean[c * CAPACITY + id];
        packed[PACKED_NEAREST * PACKED_STRIDE + e] = nearest[id];
    }
}
