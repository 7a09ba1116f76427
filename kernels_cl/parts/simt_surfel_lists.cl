// Lists of surfels in ascending order for devices that run work-items in lockstep: a work-item per entry,
// where parts/surfel_sort.cl has one per cell, of no surfel or of hundreds. Neighbours are entries of the
// same list or of the next: they read the same addresses or neighbouring ones.
// Macros: those of parts/surfel_sort.cl. Entries past the total end at once.
#include "parts/surfel_grid.cl"
#include "parts/surfels.cl"

#define TOTAL(starts) min((starts)[GRID_CELLS], (uint)ENTRIES)

// order_lists: puts each entry where its surfel's ID belongs in its cell's list, behind all lower ones
// (an ID is in a list once), and beside it what a lookup reads: the result is that of sort_lists and
// pack_lists. An entry reads its whole list, which its neighbours read, too.
// entries: (ENTRIES,) surfel and cell, each cell's together, in any order. mean: (3, CAPACITY) irradiance,
// W/m2. nearest: (CAPACITY,) least mean depth, m.
__kernel void order_lists(__global const uint *starts, __global const uint2 *entries,
                          __global const float *world_position, __global const float *world_normal,
                          __global const float *radii, __global const float *mean,
                          __global const float *nearest, __global uint *ids, __global float *packed)
{
    const size_t e = get_global_id(0);
    if (e >= TOTAL(starts))
        return;
    const uint id = entries[e].x, cell = entries[e].y;
    const uint start = starts[cell], end = min(starts[cell + 1], (uint)ENTRIES);
    uint at = start;
    for (uint other = start; other < end; ++other)
        at += entries[other].x < id;
    ids[at] = id;
    for (int c = 0; c < 3; ++c) {
        packed[c * PACKED_STRIDE + at] = world_position[c * CAPACITY + id];
        packed[(3 + c) * PACKED_STRIDE + at] = world_normal[c * CAPACITY + id];
        packed[(PACKED_IRRADIANCE + c) * PACKED_STRIDE + at] = mean[c * CAPACITY + id];
    }
    packed[PACKED_RADIUS * PACKED_STRIDE + at] = 1.0f / radii[id];
    packed[PACKED_NEAREST * PACKED_STRIDE + at] = nearest[id];
}

// pack_irradiance: refreshes in `packed` what the irradiance pass has changed.
__kernel void pack_irradiance(__global const uint *starts, __global const uint *ids,
                              __global const float *mean, __global const float *nearest,
                              __global float *packed)
{
    const size_t e = get_global_id(0);
    if (e >= TOTAL(starts))
        return;
    const uint id = ids[e];
    for (int c = 0; c < 3; ++c)
        packed[(PACKED_IRRADIANCE + c) * PACKED_STRIDE + e] = mean[c * CAPACITY + id];
    packed[PACKED_NEAREST * PACKED_STRIDE + e] = nearest[id];
}
