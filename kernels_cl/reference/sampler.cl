// Low-discrepancy samples without tables: the first two Sobol dimensions, shuffled and Owen
// scrambled by hashing (Burley 2020, "Practical Hash-based Owen Scrambling", JCGT 9(4), sections
// 3 and 4). Every pair of dimensions of a path has its own seed, so pairs are independent and
// each pair is a (0, 2)-sequence over the samples of one receiver.
#ifndef GIBENCH_REFERENCE_SAMPLER
#define GIBENCH_REFERENCE_SAMPLER

// Chris Wellons' lowbias32, "Hash Function Prospector" (2018).
inline uint hash_uint(uint x)
{
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    x ^= x >> 16;
    return x;
}

inline uint hash_pair(uint a, uint b)
{
    return hash_uint(a ^ (hash_uint(b) + 0x9e3779b9u));
}

inline uint reverse_bits(uint x)
{
    x = as_uint(as_uchar4(x).wzyx);
    x = ((x & 0xf0f0f0f0u) >> 4) | ((x & 0x0f0f0f0fu) << 4);
    x = ((x & 0xccccccccu) >> 2) | ((x & 0x33333333u) << 2);
    return ((x & 0xaaaaaaaau) >> 1) | ((x & 0x55555555u) << 1);
}

// A random Owen scramble of a number whose bits are reversed (Laine and Karras 2011, with the
// constants of Vegdahl 2021, "Building a Better LK Hash").
inline uint laine_karras(uint x, uint seed)
{
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

// The second Sobol dimension, bits reversed. Its matrix is Pascal's triangle modulo 2, a Kronecker
// power of (1 1; 0 1), hence five steps instead of thirty-two.
inline uint sobol_second_reversed(uint x)
{
    x ^= (x & 0xaaaaaaaau) >> 1;
    x ^= (x & 0xccccccccu) >> 2;
    x ^= (x & 0xf0f0f0f0u) >> 4;
    x ^= (x & 0xff00ff00u) >> 8;
    x ^= (x & 0xffff0000u) >> 16;
    return x;
}

// To [0, 1): 24 bits are what a float holds evenly.
inline float unit_float(uint x)
{
    return (float)(x >> 8) * 0x1p-24f;
}

// Sample `index` of the pair of dimensions that `seed` names, in [0, 1)^2.
inline float2 sample_2d(uint index, uint seed)
{
    const uint i = reverse_bits(laine_karras(reverse_bits(index), seed));
    const uint first = laine_karras(i, hash_uint(seed ^ 0x68bc21ebu));
    const uint second = laine_karras(sobol_second_reversed(i), hash_uint(seed ^ 0x02e5be93u));
    return (float2)(unit_float(reverse_bits(first)), unit_float(reverse_bits(second)));
}

// Sample `index` of the single dimension that `seed` names, in [0, 1).
inline float sample_1d(uint index, uint seed)
{
    const uint i = reverse_bits(laine_karras(reverse_bits(index), seed));
    return unit_float(reverse_bits(laine_karras(i, hash_uint(seed ^ 0x68bc21ebu))));
}

// Which dimensions are which: four to a vertex, two more where a path starts.
#define DIM_SCATTER(vertex) (4u * (vertex))
#define DIM_EMITTER(vertex) (4u * (vertex) + 1u)
#define DIM_ENVIRONMENT(vertex) (4u * (vertex) + 2u)
#define DIM_ROULETTE(vertex) (4u * (vertex) + 3u)
#define DIM_FRAGMENT 0x7fff0000u
#define DIM_START 0x7fff0001u

inline uint dimension_seed(uint owner, uint round_seed, uint dimension)
{
    return hash_pair(hash_pair(owner, round_seed), dimension);
}

// (cos, sin) of 2 pi turns, turns in [0, 1): Taylor series within an eighth of a turn, to 2e-7. The
// builtins reduce arguments of any size and cost several times as much.
inline float2 cos_sin_turns(float turns)
{
    const int quarter = (int)(4.0f * turns + 0.5f);
    const float x = 6.28318530718f * (turns - 0.25f * (float)quarter), xx = x * x;
    const float s =
        x * (1.0f + xx * (-1.0f / 6 + xx * (1.0f / 120 + xx * (-1.0f / 5040 + xx / 362880))));
    const float c =
        1.0f + xx * (-0.5f + xx * (1.0f / 24 + xx * (-1.0f / 720 + xx / 40320)));
    const float2 turned = quarter & 1 ? (float2)(-s, c) : (float2)(c, s);
    return quarter & 2 ? -turned : turned;
}

#endif
