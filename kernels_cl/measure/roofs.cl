// The machine's roofs: how fast it streams, multiplies and launches.
// VEC is the vector width in floats. STREAM: McCalpin 1995, "Memory Bandwidth and Machine Balance
// in Current High Performance Computers". The multiply-add loop follows clpeak.

#if VEC == 1
#define FLOATS float
#else
#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define FLOATS JOIN(float, VEC)
#endif

// STREAM triad: a[i] = b[i] + scalar * c[i], one vector per turn. Each work-item owns `stretch`
// consecutive vectors, so that a group walks whole pages.
__kernel void roof_triad(__global FLOATS *a, __global const FLOATS *b, __global const FLOATS *c,
                         const float scalar, const uint count, const uint stretch)
{
    const uint first = (uint)get_global_id(0) * stretch;
    const uint last = min(first + stretch, count);
    for (uint i = first; i < last; ++i)
        a[i] = b[i] + scalar * c[i];
}

// Streaming read: four independent sums over `stretch` consecutive vectors (a multiple of four);
// one vector is written per work-item, so that nothing is optimised away.
__kernel void roof_read(__global FLOATS *sums, __global const FLOATS *b, const uint count,
                        const uint stretch)
{
    const uint item = (uint)get_global_id(0);
    const uint first = item * stretch;
    const uint last = min(first + stretch, count);
    FLOATS s0 = (FLOATS)(0.0f), s1 = s0, s2 = s0, s3 = s0;
    for (uint i = first; i + 3 < last; i += 4) {
        s0 += b[i];
        s1 += b[i + 1];
        s2 += b[i + 2];
        s3 += b[i + 3];
    }
    if (first < last)
        sums[item] = (s0 + s1) + (s2 + s3);
}

// Independent multiply-add chains, ten vectors wide: enough to cover the latency of the units.
// Per work-item: turns * 10 * VEC * 2 flops.
__kernel void roof_fma(__global FLOATS *out, const float factor, const uint turns, const uint count)
{
    const uint item = (uint)get_global_id(0);
    const FLOATS m = (FLOATS)(factor);
    const FLOATS s = (FLOATS)(0.5f + (float)(item & 7));
    FLOATS x0 = s, x1 = s + 1.0f, x2 = s + 2.0f, x3 = s + 3.0f, x4 = s + 4.0f;
    FLOATS x5 = s + 5.0f, x6 = s + 6.0f, x7 = s + 7.0f, x8 = s + 8.0f, x9 = s + 9.0f;
    for (uint i = 0; i < turns; ++i) {
        x0 = x0 * m + s;
        x1 = x1 * m + s;
        x2 = x2 * m + s;
        x3 = x3 * m + s;
        x4 = x4 * m + s;
        x5 = x5 * m + s;
        x6 = x6 * m + s;
        x7 = x7 * m + s;
        x8 = x8 * m + s;
        x9 = x9 * m + s;
    }
    if (item < count)
        out[item] = ((x0 + x1) + (x2 + x3)) + ((x4 + x5) + (x6 + x7)) + (x8 + x9);
}

// One store: what is left of a launch when there is nothing to do.
__kernel void roof_launch(__global float *out)
{
    if (get_global_id(0) == 0)
        out[0] = 1.0f;
}
