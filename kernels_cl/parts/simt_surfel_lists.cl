// Lists of surfels in ascending order for devices that run work-items in lockstep: a work-item per entry,
// where parts/surfel_sort.cl has one per cell, of no surfel or of hundreds. Neighbours are entries of the
// same list or of the next: they read the same addresses or neighbouring ones. The host does not know how
// many entries there are: as many work-items as it likes take all of them in turns.
// Macros: those of parts/surfel_sort.cl.
#include "parts/surfel_grid.cl"
#include "parts/surfels.cl"

#define FOR_EACH_ENTRY(starts, e)                                                              \
    const size_t total_ = min((starts)[GRID_CELLS], (uint)ENTRIES);                            \
    for (size_t e = get_global_id(0); e < total_; e += get_global_size(0))

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
    FOR_EACH_ENTRY(starts, e) {
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
}

// pack_irradiance: refreshes in `packed` what the irradiance pass has changed.
__kernel void pack_irradiance(__global const uint *starts, __global const uint *ids,
                              __global const float *mean, __global const float *nearest,
                              __global float *packed)
{
    FOR_EACH_ENTRY(starts, e) {
        const uint id = ids[e];
        for (int c = 0; c < 3; ++c)
            packed[(PACKED_IRRADIANCE + c) * PACKED_STRIDE + e] = mean[c * CAPACITY + id];
        packed[PACKED_NEAREST * PACKED_STRIDE + e] = nearest[id];
    }
}
