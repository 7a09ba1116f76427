// Exclusive prefix sums of uint, any length, in global memory.
//
// Two algorithms with the same result:
//   waves   the wave-wise recursion of Ekberg 2022, section 4.2.2: scan within waves, then scan the
//           waves' totals in the same way, until one wave holds all; then add downwards.
//           scan_waves once per level, scan_add once per level but the last.
//   blocks  reduce, scan the blocks' sums in one group, scan the blocks (Sengupta et al. 2007,
//           "Scan Primitives for GPU Computing"): three launches, each value read twice and written
//           once. A single-pass scan with decoupled look-back is ruled out: OpenCL 1.2 does not
//           promise that a waiting work-group's predecessors ever run.
//
// `length` points to the number of values, so that one set of arguments serves a length that
// changes with the frame. All sums are modulo 2^32.
#ifndef GIBENCH_SCAN
#define GIBENCH_SCAN

// Macros: WAVE, work-items of a wave, which divide the work-group size; without it there is no scan by
// waves. SCAN_ITEMS, values per work-item of the blocked scan.
// STAGED: values per work-item that lie in local memory at once in the layout `simt`, a divisor of SCAN_ITEMS:
// neighbouring work-items fetch and store neighbouring values, and each adds up its own from there.
// 0: every work-item reads its own from global memory.

#if WAVE

// scan_waves: one work-item per value.
//   prefix[i] = sum of the values before i in the same wave; totals[w] = sum of wave w.
// WaveActivePrefixSum stands for itself as log2(WAVE) steps in local memory: OpenCL 1.2 has no
// sub-groups. partial: 2 * local size words.
__kernel void scan_waves(__global const uint *values, __global const uint *length,
                         __global uint *prefix, __global uint *totals, __local uint *partial)
{
    const uint i = get_global_id(0), n = length[0];
    const int item = get_local_id(0), size = get_local_size(0);
    const int lane = item % WAVE;
    const uint value = i < n ? values[i] : 0u;
    int from = 0, to = size;
    partial[item] = value;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int step = 1; step < WAVE; step *= 2) {
        partial[to + item] = partial[from + item] + (lane >= step ? partial[from + item - step] : 0);
        barrier(CLK_LOCAL_MEM_FENCE);
        from = size - from;
        to = size - to;
    }
    if (i < n) {
        const uint inclusive = partial[from + item];
        prefix[i] = inclusive - value;
        if (lane == WAVE - 1 || i == n - 1)
            totals[i / WAVE] = inclusive;
    }
}

// scan_add: one work-item per value; prefix[i] += offsets[i / WAVE].
__kernel void scan_add(__global uint *prefix, __global const uint *length,
                       __global const uint *offsets)
{
    const uint i = get_global_id(0);
    if (i < length[0])
        prefix[i] += offsets[i / WAVE];
}
#endif

// Inclusive prefix sum over the work-group, any size; `partial` holds 2 * local size words. Every
// work-item must call it.
inline uint scan_group(uint value, __local uint *partial)
{
    // Not ints: see srp/simt_projection.cl.
    const size_t item = get_local_id(0), size = get_local_size(0);
    size_t from = 0, to = size;
    partial[item] = value;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (size_t step = 1; step < size; step *= 2) {
        partial[to + item] = partial[from + item] + (item >= step ? partial[from + item - step] : 0);
        barrier(CLK_LOCAL_MEM_FENCE);
        from = size - from;
        to = size - to;
    }
    return partial[from + item];
}

// The sum of the SCAN_ITEMS values from `first` on, zeros past the end.
inline uint scan_item_sum(__global const uint *values, uint first, uint n)
{
    const uint end = min(first + SCAN_ITEMS, n);
    uint sum = 0;
    for (uint i = first; i < end; ++i)
        sum += values[i];
    return sum;
}

// The sum of a share of the block's values, neighbours' work-items' beside each other.
inline uint scan_share_sum(__global const uint *values, uint block, uint n)
{
    const size_t item = get_local_id(0), size = get_local_size(0);
    uint sum = 0;
    for (size_t turn = block; turn < block + size * SCAN_ITEMS; turn += size)
        sum += turn + item < n ? values[turn + item] : 0u;
    return sum;
}

// scan_block_sums: one work-group per block of local size * SCAN_ITEMS values; sums[b] = block b's.
__kernel void scan_block_sums(__global const uint *values, __global const uint *length,
                              __global uint *sums, __local uint *partial)
{
    const int item = get_local_id(0), size = get_local_size(0);
#if STAGED
    const uint own = scan_share_sum(values, get_group_id(0) * size * SCAN_ITEMS, length[0]);
#else
    const uint own = scan_item_sum(values, get_global_id(0) * SCAN_ITEMS, length[0]);
#endif
    const uint sum = scan_group(own, partial);
    if (item == size - 1)
        sums[get_group_id(0)] = sum;
}

// scan_sums: one work-group; sums become the exclusive prefix of themselves, in place.
__kernel void scan_sums(__global uint *sums, __global const uint *length, __local uint *partial)
{
    const uint item = get_local_id(0), size = get_local_size(0);
    const uint block = size * SCAN_ITEMS;
    const uint blocks = length[0] / block + (length[0] % block != 0);
    uint carry = 0;
    for (uint first = 0; first < blocks; first += size) {
        const uint i = first + item;
        const uint value = i < blocks ? sums[i] : 0u;
        const uint inclusive = scan_group(value, partial);
        if (i < blocks)
            sums[i] = carry + inclusive - value;
        barrier(CLK_LOCAL_MEM_FENCE);
        if (item == size - 1)
            partial[0] = inclusive;
        barrier(CLK_LOCAL_MEM_FENCE);
        carry += partial[0];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
}

// A word is left free behind every work-item's values, so that no two of a SIMD group that are at the
// same one of theirs are on one bank.
#define STAGED_AT(i) ((i) + (i) / STAGED)

// scan_blocks: one work-group per block; prefix[i] = sum of all values before i, for i in [0, n]:
// prefix has n + 1 words, the last one is the total. partial: 2 * local size words and, STAGED,
// STAGED + 1 more per work-item.
__kernel void scan_blocks(__global const uint *values, __global const uint *length,
                          __global const uint *sums, __global uint *prefix, __local uint *partial)
{
    const uint n = length[0];
#if STAGED
    const size_t item = get_local_id(0), size = get_local_size(0);
    const size_t block = get_group_id(0) * size * SCAN_ITEMS;
    __local uint *staged = partial + 2 * size;
    __local uint *own = staged + item * (STAGED + 1);
    uint carry = sums[get_group_id(0)];
    for (int turn = 0; turn < SCAN_ITEMS / STAGED; ++turn) {
        const size_t first = block + turn * size * STAGED;
        for (size_t k = 0; k < size * STAGED; k += size)
            staged[STAGED_AT(k + item)] = first + k + item < n ? values[first + k + item] : 0;
        barrier(CLK_LOCAL_MEM_FENCE);
        uint sum = 0;
        for (int i = 0; i < STAGED; ++i)
            sum += own[i];
        const uint inclusive = scan_group(sum, partial);
        uint running = carry + inclusive - sum;
        for (int i = 0; i < STAGED; ++i) {
            const uint value = own[i];
            own[i] = running;
            running += value;
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        if (item == size - 1)
            partial[0] = running;
        for (size_t k = 0; k < size * STAGED; k += size)
            if (first + k + item < n)
                prefix[first + k + item] = staged[STAGED_AT(k + item)];
        barrier(CLK_LOCAL_MEM_FENCE);
        carry = partial[0];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (item == 0 && block < n && n - block <= size * SCAN_ITEMS)
        prefix[n] = carry;
#else
    const uint first = get_global_id(0) * SCAN_ITEMS;
    const uint own = scan_item_sum(values, first, n);
    uint running = sums[get_group_id(0)] + scan_group(own, partial) - own;
    const uint end = min(first + SCAN_ITEMS, n);
    for (uint i = first; i < end; ++i) {
        const uint value = values[i];
        prefix[i] = running;
        running += value;
    }
    if (first < n && end == n)
        prefix[n] = running;
#endif
}

#endif
