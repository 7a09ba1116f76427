// Transport matrices as stored: fp32, fp16 or snorm16, scaled per light basis vector.
// Macros: STORAGE (one of STORAGE_*), VEC.
//
// fp16 values are scaled so that the largest of a row lies in [2^14, 2^15) and those that would be
// subnormal are stored as 0 (gibench.techniques.srp.pack); so bits expand to a float by a shift of
// the exponent, without a special case.
#ifndef GIBENCH_SRP_STORAGE
#define GIBENCH_SRP_STORAGE

#include "common/vec_width.cl"

#define STORAGE_FP32 0
#define STORAGE_FP16 1
#define STORAGE_SNORM16 2

// The i-th vector behind a pointer that is aligned to whole vectors. Not vloadn: PoCL 3 leaves that
// a function call, around which every accumulator is spilled.
#if VEC == 1
#define float_vector(i, p) ((p)[i])
#define short_vector(i, p) ((p)[i])
#else
#define float_vector(i, p) (((__global const VEC_JOIN(float, VEC) *)(p))[i])
#define short_vector(i, p) (((__global const VEC_JOIN(short, VEC) *)(p))[i])
#endif

#if STORAGE == STORAGE_FP32
typedef float stored_t;
#define stored_scalar(p) (*(p))
#define stored_vector(i, p) float_vector(i, p)
#elif STORAGE == STORAGE_SNORM16
typedef short stored_t;
#define stored_scalar(p) ((float)*(p))
#if VEC == 1
#define stored_vector(i, p) ((float)(p)[i])
#else
#define stored_vector(i, p) VEC_JOIN(convert_float, VEC)(short_vector(i, p))
#endif
#else
typedef short stored_t; // the bits of a half
#define stored_scalar(p) vload_half(0, (__global const half *)(p))
#if VEC == 1
#define stored_vector(i, p) vload_half(i, (__global const half *)(p))
#else
// x86 converts a vector of halves in one instruction; vload_halfn is a function call in PoCL.
#if VEC == 16 && defined(__AVX512F__) && defined(__clang__)
#define stored_vector(i, p) \
    __builtin_ia32_vcvtph2ps512_mask(short_vector(i, p), (float16)(0.0f), (ushort)0xffff, 4)
#elif VEC == 8 && defined(__F16C__) && defined(__clang__)
#define stored_vector(i, p) __builtin_ia32_vcvtph2ps256(short_vector(i, p))
#else
// Sign to bit 31, exponent and mantissa to where a float has them, less a bias of 127 - 15.
#define stored_vector(i, p)                                                           \
    (VEC_JOIN(as_float, VEC)((VEC_JOIN(convert_int, VEC)(short_vector(i, p)) << 13) & \
                             (int)0x8fffe000) *                                       \
     0x1p112f)
#endif
#endif
#endif

// Fetch the BYTES that lie STREAM_AHEAD behind a pointer into a matrix that is read once from start
// to end, into the second cache level and not the first: there the stream would throw out what is
// used again. x86 prefetchers stop at every 4 KiB page and leave the arithmetic, which 16-bit values
// keep as busy as the memory, waiting. One core of Zen 4, Sponza's sizes, fp16: projection 3.3 ms
// without, 2.3 ms with, 3.5 ms into the first level; fp32 gains nothing. A hint: what lies behind
// the matrix's end is not touched. FETCHES=1 where the host knows a processor that its compiler does not
// name (Intel's runtime compiles for SPIR-V).
#define CACHE_LINE 64
#if STORAGE != STORAGE_FP32 && defined(__clang__) && (defined(__x86_64__) || FETCHES)
#define STREAM_AHEAD 16384
#define FETCH_AHEAD(p, BYTES)                                                     \
    _Pragma("unroll") for (int line = 0; line < (int)(BYTES); line += CACHE_LINE) \
        __builtin_prefetch((__global const char *)(p) + STREAM_AHEAD + line, 0, 2);
#else
#define FETCH_AHEAD(p, BYTES)
#endif

// Pairs of values in 4-byte words, for work-items side by side: a step is a word for each of `stride`
// work-items. Of 16 bits a word is a pair; of 32 bits a pair is two steps. By arithmetic alone, which
// vectorises over work-items on every runtime: Intel's for CPUs calls a function for each vload_half.
#if STORAGE == STORAGE_FP32
typedef float word_t;
typedef float2 pair_t;
#define PAIR_WORDS 2
#define pair_at(p, j, stride, item)                         \
    ((float2)((p)[(size_t)(2 * (j) * (stride)) + (item)],   \
              (p)[(size_t)((2 * (j) + 1) * (stride)) + (item)]))
#define pair_first(pair) ((pair).x)
#define pair_second(pair) ((pair).y)
#else
typedef int word_t;
typedef int pair_t;
#define PAIR_WORDS 1
#define pair_at(p, j, stride, item) ((p)[(size_t)((j) * (stride)) + (item)])
#if STORAGE == STORAGE_SNORM16
#define pair_first(pair) ((float)(((pair) << 16) >> 16))
#define pair_second(pair) ((float)((pair) >> 16))
#else
#define half_of(bits) (as_float((bits) & (int)0x8fffe000) * 0x1p112f)
#define pair_first(pair) half_of(((pair) << 16) >> 3)
#define pair_second(pair) half_of((pair) >> 3)
#endif
#endif

// Sum of all lanes, pairwise.
inline float lane_sum(vfloat v)
{
#if VEC == 1
    return v;
#else
#if VEC >= 16
    // Through memory rather than v.lo and v.hi, which Oclgrind takes for uninitialised at this width.
    const float8 *half_of = (const float8 *)&v;
    const float8 v8 = half_of[0] + half_of[1];
#elif VEC == 8
    const float8 v8 = v;
#endif
#if VEC >= 8
    const float4 v4 = v8.lo + v8.hi;
#elif VEC == 4
    const float4 v4 = v;
#endif
#if VEC >= 4
    const float2 v2 = v4.lo + v4.hi;
#else
    const float2 v2 = v;
#endif
    return v2.x + v2.y;
#endif
}

#endif
