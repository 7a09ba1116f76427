// Low-discrepancy samples without tables: the first two Sobol dimensions, shuffled and Owen
// scrambled by hashing (Burley 2020, "Practical Hash-based Owen Scrambling", JCGT 9(4), sections
// 3 and 4). Every pair of dimensions of a path has its own seed, so pairs are independent and
// each pair is a (0, 2)-sequence over the samples of one receiver. VEC of them are drawn at once.
#ifndef GIBENCH_REFERENCE_SAMPLER
#define GIBENCH_REFERENCE_SAMPLER
#include "common/vec_width.cl"

#if VEC <= 1
#define VEC_INT_BITS(v) as_int(v)
#else
#define VEC_INT_BITS(v) VEC_JOIN(as_int, VEC)(v)
#endif

// Chris Wellons' lowbias32, "Hash Function Prospector" (2018).
inline vuint hash_uint(vuint x)
{
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    x ^= x >> 16;
    return x;
}

inline vuint hash_pair(vuint a, vuint b)
{
    return hash_uint(a ^ (hash_uint(b) + 0x9e3779b9u));
}

inline vuint reverse_bits(vuint x)
{
    x = (x >> 24) | ((x >> 8) & 0xff00u) | ((x << 8) & 0xff0000u) | (x << 24);
    x = ((x & 0xf0f0f0f0u) >> 4) | ((x & 0x0f0f0f0fu) << 4);
    x = ((x & 0xccccccccu) >> 2) | ((x & 0x33333333u) << 2);
    return ((x & 0xaaaaaaaau) >> 1) | ((x & 0x55555555u) << 1);
}

// A random Owen scramble of a number whose bits are reversed (Laine and Karras 2011, with the
// constants of Vegdahl 2021, "Building a Better LK Hash").
inline vuint laine_karras(vuint x, vuint seed)
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
inline vuint sobol_second_reversed(vuint x)
{
    x ^= (x & 0xaaaaaaaau) >> 1;
    x ^= (x & 0xccccccccu) >> 2;
    x ^= (x & 0xf0f0f0f0u) >> 4;
    x ^= (x & 0xff00ff00u) >> 8;
    x ^= (x & 0xffff0000u) >> 16;
    return x;
}

// To [0, 1): 24 bits are what a float holds evenly.
inline vfloat unit_float(vuint x)
{
    return vec_float_of(VEC_INT_BITS(x >> 8)) * 0x1p-24f;
}

// Sample `index` of the single dimension that `seed` names, in [0, 1): the first of its pair.
inline vfloat sample_1d(vuint index, vuint seed)
{
    const vuint i = reverse_bits(laine_karras(reverse_bits(index), seed));
    return unit_float(reverse_bits(laine_karras(i, hash_uint(seed ^ 0x68bc21ebu))));
}

// Sample `index` of the pair of dimensions that `seed` names, in [0, 1)^2.
inline void sample_2d(vuint index, vuint seed, vfloat *x, vfloat *y)
{
    const vuint i = reverse_bits(laine_karras(reverse_bits(index), seed));
    const vuint first = laine_karras(i, hash_uint(seed ^ 0x68bc21ebu));
    const vuint second = laine_karras(sobol_second_reversed(i), hash_uint(seed ^ 0x02e5be93u));
    *x = unit_float(reverse_bits(first));
    *y = unit_float(reverse_bits(second));
}

// Which dimensions are which: four to a vertex, two more where a path starts.
#define DIM_SCATTER(vertex) (4u * (vertex))
#define DIM_EMITTER(vertex) (4u * (vertex) + 1u)
#define DIM_ENVIRONMENT(vertex) (4u * (vertex) + 2u)
#define DIM_ROULETTE(vertex) (4u * (vertex) + 3u)
#define DIM_FRAGMENT 0x7fff0000u
#define DIM_START 0x7fff0001u

// What one owner's dimensions have in common in one round.
inline vuint owner_seed(vuint owner, uint round_seed)
{
    return hash_pair(owner, (vuint)(round_seed));
}

inline vuint dimension_seed(vuint of_owner, uint dimension)
{
    return hash_pair(of_owner, (vuint)(dimension));
}

// Cosine and sine of 2 pi turns, turns in [0, 1): Taylor series within an eighth of a turn, to 2e-7.
// The builtins reduce arguments of any size and cost several times as much. For numbers and vectors.
#define COS_SIN_TURNS(NAME, FLOAT, INT, FLOAT_OF, INT_OF)                                          \
    inline void NAME(FLOAT turns, FLOAT *cosine, FLOAT *sine)                                      \
    {                                                                                              \
        const INT quarter = INT_OF(4.0f * turns + 0.5f);                                           \
        const FLOAT x = 6.28318530718f * (turns - 0.25f * FLOAT_OF(quarter)), xx = x * x;          \
        const FLOAT s = x * (1.0f + xx * (-1.0f / 6 +                                              \
                             xx * (1.0f / 120 + xx * (-1.0f / 5040 + xx / 362880))));              \
        const FLOAT c =                                                                            \
            1.0f + xx * (-0.5f + xx * (1.0f / 24 + xx * (-1.0f / 720 + xx / 40320)));              \
        const INT odd = (quarter & 1) != 0, turned = (quarter & 2) != 0;                           \
        const FLOAT across = odd ? -s : c, up = odd ? c : s;                                       \
        *cosine = turned ? -across : across;                                                       \
        *sine = turned ? -up : up;                                                                 \
    }
COS_SIN_TURNS(cos_sin_turns, float, int, convert_float, convert_int)
COS_SIN_TURNS(vec_cos_sin_turns, vfloat, vint, vec_float_of, vec_int_of)

#endif
