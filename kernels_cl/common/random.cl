// Random numbers by hashing: the same for the same words, whatever ran before.
#ifndef GIBENCH_RANDOM
#define GIBENCH_RANDOM

// Random bits of a number (Wellons 2018, "Prospecting for Hash Functions", lowbias32).
inline uint random_bits(uint x)
{
    x = (x ^ (x >> 16)) * 0x7feb352du;
    x = (x ^ (x >> 15)) * 0x846ca68bu;
    return x ^ (x >> 16);
}

// Three well mixed words from three (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering",
// pcg3d).
inline uint3 random_words(uint a, uint b, uint c)
{
    uint3 v = (uint3)(a, b, c) * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> 16u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    return v;
}

// In [0, 1).
inline float unit_float(uint word)
{
    return (word >> 8) * (1.0f / 16777216.0f);
}

#endif
