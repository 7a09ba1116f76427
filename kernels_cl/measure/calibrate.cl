// How long one access and one multiply-add take when the next needs its result.

// calibrate_chase: one work-item follows `next` from entry to entry, `steps` times. In a table of one
// cycle each address is known only when the load before it has come back, so that nothing overlaps:
// time over steps is the latency of whatever level the table fits (Saavedra and Smith 1995).
// next: (n,) the entry to go to. out: (1,) where it ended.
__kernel void calibrate_chase(__global const uint *next, const uint steps, __global uint *out)
{
    if (get_global_id(0) != 0)
        return;
    uint at = 0;
    for (uint i = 0; i < steps; ++i)
        at = next[at];
    out[0] = at;
}

// calibrate_chain: one work-item's multiply-adds, each of the one before, 8 a turn.
// out: (1,) the last.
__kernel void calibrate_chain(const float factor, const float addend, const uint turns,
                              __global float *out)
{
    if (get_global_id(0) != 0)
        return;
    float x = addend;
    for (uint i = 0; i < turns; ++i) {
        x = fma(x, factor, addend);
        x = fma(x, factor, addend);
        x = fma(x, factor, addend);
        x = fma(x, factor, addend);
        x = fma(x, factor, addend);
        x = fma(x, factor, addend);
        x = fma(x, factor, addend);
        x = fma(x, factor, addend);
    }
    out[0] = x;
}
