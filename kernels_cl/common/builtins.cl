// OpenCL C's small builtins as inline functions, for PoCL; begins every program (device/source.py).
//
// PoCL links its builtins from a library that was compiled for another processor than the kernels
// (all with AVX2 as for Haswell). LLVM does not inline across that difference: every dot, clamp or
// sqrt stays a function call, and around a call no vector register survives. Elsewhere this file
// is empty and the compiler's own builtins serve.
//
// Each does what the specification says (OpenCL 1.2, sections 6.12.2 to 6.12.7) within its accuracy,
// but that length, distance and normalize do not guard against overflow of the squares. A type
// that is missing here is an error of compilation, never a silent call.
#ifndef GIBENCH_BUILTINS
#define GIBENCH_BUILTINS
#if defined(POCL_DEVICE_ADDRESS_BITS) && defined(__x86_64__) && defined(__has_builtin)
#if __has_builtin(__builtin_elementwise_floor) // clang 14

#undef min
#undef max
#undef clamp
#undef mix
#undef fmin
#undef fmax
#undef fabs
#undef floor
#undef ceil
#undef sqrt
#undef rsqrt
#undef copysign
#undef smoothstep
#undef dot
#undef cross
#undef length
#undef distance
#undef normalize
#undef select
#undef any
// PoCL's names for these would else be what a width is joined to (VEC_JOIN).
#undef convert_float
#undef convert_int
#undef vload
#undef vstore
#undef convert_float2
#undef convert_float3
#undef convert_float4
#undef convert_int2
#undef convert_int3
#undef convert_int4
#undef convert_int3_rtn
#undef convert_int3_sat
#undef convert_float8
#undef convert_float16
#undef convert_int8
#undef convert_int16
#undef clz
#undef vload2
#undef vload3
#undef vload4
#undef vload8
#undef vload16
#undef vstore2
#undef vstore3
#undef vstore4
#undef vstore8
#undef vstore16

#define INLINE_BUILTIN static inline __attribute__((overloadable, always_inline))

// -- numbers and vectors of them --------------------------------------------------------------

// x86's own minimum and maximum are these very conditionals.
#define INLINE_ORDERED(T) \
    INLINE_BUILTIN T inline_min(T a, T b) { return b < a ? b : a; } \
    INLINE_BUILTIN T inline_max(T a, T b) { return a < b ? b : a; } \
    INLINE_BUILTIN T inline_clamp(T x, T low, T high) { return inline_min(inline_max(x, low), high); }
#define INLINE_ORDERED_BY_NUMBERS(T, S) \
    INLINE_ORDERED(T) \
    INLINE_BUILTIN T inline_min(T a, S b) { return inline_min(a, (T)(b)); } \
    INLINE_BUILTIN T inline_max(T a, S b) { return inline_max(a, (T)(b)); } \
    INLINE_BUILTIN T inline_clamp(T x, S low, S high) { return inline_clamp(x, (T)(low), (T)(high)); }

INLINE_ORDERED(int)
INLINE_ORDERED(uint)
INLINE_ORDERED(long)
INLINE_ORDERED(ulong)
INLINE_ORDERED(float)
INLINE_ORDERED_BY_NUMBERS(int2, int)
INLINE_ORDERED_BY_NUMBERS(int3, int)
INLINE_ORDERED_BY_NUMBERS(int4, int)
INLINE_ORDERED_BY_NUMBERS(float2, float)
INLINE_ORDERED_BY_NUMBERS(float3, float)
INLINE_ORDERED_BY_NUMBERS(float4, float)
INLINE_ORDERED_BY_NUMBERS(float8, float)
INLINE_ORDERED_BY_NUMBERS(float16, float)

// Of a number and something that is none, fmin and fmax give the number.
#define INLINE_FLOATS(T) \
    INLINE_BUILTIN T inline_fmin(T a, T b) { return __builtin_elementwise_min(a, b); } \
    INLINE_BUILTIN T inline_fmax(T a, T b) { return __builtin_elementwise_max(a, b); } \
    INLINE_BUILTIN T inline_fabs(T x) { return __builtin_elementwise_abs(x); } \
    INLINE_BUILTIN T inline_floor(T x) { return __builtin_elementwise_floor(x); } \
    INLINE_BUILTIN T inline_ceil(T x) { return __builtin_elementwise_ceil(x); } \
    INLINE_BUILTIN T inline_mix(T a, T b, T t) { return a + (b - a) * t; } \
    INLINE_BUILTIN T inline_rsqrt(T x) { return 1.0f / inline_sqrt(x); } \
    INLINE_BUILTIN T inline_smoothstep(T low, T high, T x) \
    { \
        const T t = inline_clamp((x - low) / (high - low), (T)(0.0f), (T)(1.0f)); \
        return t * t * (3.0f - 2.0f * t); \
    }
#define INLINE_FLOATS_BY_NUMBERS(T, I) \
    INLINE_FLOATS(T) \
    INLINE_BUILTIN T inline_fmin(T a, float b) { return inline_fmin(a, (T)(b)); } \
    INLINE_BUILTIN T inline_fmax(T a, float b) { return inline_fmax(a, (T)(b)); } \
    INLINE_BUILTIN T inline_mix(T a, T b, float t) { return a + (b - a) * t; } \
    INLINE_BUILTIN T inline_copysign(T x, T sign) \
    { \
        return __builtin_astype((__builtin_astype(x, I) & (I)(0x7fffffff)) | \
                                    (__builtin_astype(sign, I) & (I)(0x80000000)), \
                                T); \
    }

INLINE_BUILTIN float inline_sqrt(float x) { return __builtin_sqrtf(x); }
INLINE_BUILTIN float2 inline_sqrt(float2 x) { return (float2)(inline_sqrt(x.x), inline_sqrt(x.y)); }
INLINE_BUILTIN float3 inline_sqrt(float3 x) { return (float3)(inline_sqrt(x.xy), inline_sqrt(x.z)); }
INLINE_BUILTIN float4 inline_sqrt(float4 x) { return (float4)(inline_sqrt(x.lo), inline_sqrt(x.hi)); }
INLINE_BUILTIN float8 inline_sqrt(float8 x) { return (float8)(inline_sqrt(x.lo), inline_sqrt(x.hi)); }
INLINE_BUILTIN float16 inline_sqrt(float16 x) { return (float16)(inline_sqrt(x.lo), inline_sqrt(x.hi)); }

INLINE_FLOATS(float)
INLINE_FLOATS_BY_NUMBERS(float2, int2)
INLINE_FLOATS_BY_NUMBERS(float3, int3)
INLINE_FLOATS_BY_NUMBERS(float4, int4)
INLINE_FLOATS_BY_NUMBERS(float8, int8)
INLINE_FLOATS_BY_NUMBERS(float16, int16)
INLINE_BUILTIN float inline_copysign(float x, float sign) { return __builtin_copysignf(x, sign); }

// -- geometry ---------------------------------------------------------------------------------

INLINE_BUILTIN float inline_dot(float2 a, float2 b) { return a.x * b.x + a.y * b.y; }
INLINE_BUILTIN float inline_dot(float3 a, float3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
INLINE_BUILTIN float inline_dot(float4 a, float4 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w;
}
INLINE_BUILTIN float3 inline_cross(float3 a, float3 b)
{
    return (float3)(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
#define INLINE_GEOMETRY(T) \
    INLINE_BUILTIN float inline_length(T v) { return inline_sqrt(inline_dot(v, v)); } \
    INLINE_BUILTIN float inline_distance(T a, T b) { return inline_length(a - b); } \
    INLINE_BUILTIN T inline_normalize(T v) \
    { \
        const float squared = inline_dot(v, v); \
        return squared > 0.0f ? v * (1.0f / inline_sqrt(squared)) : v; \
    }
INLINE_GEOMETRY(float2)
INLINE_GEOMETRY(float3)
INLINE_GEOMETRY(float4)

// -- choosing and converting ------------------------------------------------------------------

INLINE_BUILTIN int inline_any(int2 v) { return (v.x | v.y) < 0; }
INLINE_BUILTIN int inline_any(int3 v) { return (v.x | v.y | v.z) < 0; }
INLINE_BUILTIN int inline_any(int4 v) { return inline_any(v.lo | v.hi); }
INLINE_BUILTIN int inline_any(int8 v) { return inline_any(v.lo | v.hi); }
INLINE_BUILTIN int inline_any(int16 v) { return inline_any(v.lo | v.hi); }

INLINE_BUILTIN float3 inline_float3(int3 v) { return (float3)((float)v.x, (float)v.y, (float)v.z); }
INLINE_BUILTIN int3 inline_int3(float3 v) { return (int3)((int)v.x, (int)v.y, (int)v.z); }
INLINE_BUILTIN int inline_int_sat(float x)
{
    const int low = x == x ? (int)0x80000000 : 0; // 0 for what is no number
    return x >= 0x1p31f ? 0x7fffffff : x > -0x1p31f ? (int)x : low;
}
INLINE_BUILTIN int3 inline_int3_sat(float3 v)
{
    return (int3)(inline_int_sat(v.x), inline_int_sat(v.y), inline_int_sat(v.z));
}

#define INLINE_CONVERTED(FROM, TO, N) \
    INLINE_BUILTIN TO##N inline_##TO##N(FROM##N v) { return __builtin_convertvector(v, TO##N); }
#define INLINE_ALL_CONVERTED(N) \
    INLINE_CONVERTED(uchar, float, N) \
    INLINE_CONVERTED(short, float, N) \
    INLINE_CONVERTED(ushort, float, N) \
    INLINE_CONVERTED(int, float, N) \
    INLINE_CONVERTED(uint, float, N) \
    INLINE_CONVERTED(short, int, N) \
    INLINE_CONVERTED(float, int, N)
INLINE_ALL_CONVERTED(2)
INLINE_ALL_CONVERTED(4)
INLINE_ALL_CONVERTED(8)
INLINE_ALL_CONVERTED(16)

INLINE_BUILTIN uint inline_clz(uint x) { return x ? (uint)__builtin_clz(x) : 32u; }

// -- memory -----------------------------------------------------------------------------------

#define INLINE_IN_SPACE(SPACE, T, N) \
    INLINE_BUILTIN T##N inline_vload##N(size_t i, const SPACE T *p) \
    { \
        return *(const SPACE unaligned_##T##N *)(p + N * i); \
    } \
    INLINE_BUILTIN void inline_vstore##N(T##N v, size_t i, SPACE T *p) \
    { \
        *(SPACE unaligned_##T##N *)(p + N * i) = v; \
    }
#define INLINE_THREE_IN_SPACE(SPACE, T) \
    INLINE_BUILTIN T##3 inline_vload3(size_t i, const SPACE T *p) \
    { \
        return (T##3)(p[3 * i], p[3 * i + 1], p[3 * i + 2]); \
    } \
    INLINE_BUILTIN void inline_vstore3(T##3 v, size_t i, SPACE T *p) \
    { \
        p[3 * i] = v.x; \
        p[3 * i + 1] = v.y; \
        p[3 * i + 2] = v.z; \
    }
#define INLINE_IN_MEMORY(T, N) \
    typedef T##N unaligned_##T##N __attribute__((aligned(sizeof(T)))); \
    INLINE_IN_SPACE(__global, T, N) \
    INLINE_IN_SPACE(__local, T, N) \
    INLINE_IN_SPACE(__private, T, N)
#define INLINE_ALL_IN_MEMORY(T) \
    INLINE_IN_MEMORY(T, 2) \
    INLINE_IN_MEMORY(T, 4) \
    INLINE_IN_MEMORY(T, 8) \
    INLINE_IN_MEMORY(T, 16) \
    INLINE_THREE_IN_SPACE(__global, T) \
    INLINE_THREE_IN_SPACE(__local, T) \
    INLINE_THREE_IN_SPACE(__private, T)
INLINE_ALL_IN_MEMORY(float)
INLINE_ALL_IN_MEMORY(int)
INLINE_ALL_IN_MEMORY(uchar)

#ifdef __F16C__
typedef short4 unaligned_short4 __attribute__((aligned(2)));
// The processor's own conversions; 0 rounds to the nearest, as vstore_half does by default.
INLINE_BUILTIN float4 inline_vload_half4(size_t i, const __global half *p)
{
    const short4 bits = *(const __global unaligned_short4 *)((const __global short *)p + 4 * i);
    return __builtin_ia32_vcvtph2ps((short8)(bits, (short4)(0)));
}
INLINE_BUILTIN float2 inline_vload_half2(size_t i, const __global half *p)
{
    const __global short *bits = (const __global short *)p + 2 * i;
    const float4 both = __builtin_ia32_vcvtph2ps((short8)(bits[0], bits[1], (short2)(0), (short4)(0)));
    return both.lo;
}
INLINE_BUILTIN void inline_vstore_half4(float4 v, size_t i, __global half *p)
{
    const short8 bits = __builtin_ia32_vcvtps2ph(v, 0);
    *(__global unaligned_short4 *)((__global short *)p + 4 * i) = bits.lo;
}
INLINE_BUILTIN void inline_vstore_half2(float2 v, size_t i, __global half *p)
{
    const short8 bits = __builtin_ia32_vcvtps2ph((float4)(v, v), 0);
    ((__global short *)p)[2 * i] = bits.s0;
    ((__global short *)p)[2 * i + 1] = bits.s1;
}
INLINE_BUILTIN float inline_vload_half(size_t i, const __global half *p)
{
    const short bits = ((const __global short *)p)[i];
    const float4 one = __builtin_ia32_vcvtph2ps((short8)(bits, (short)0, (short2)(0), (short4)(0)));
    return one.x;
}
INLINE_BUILTIN float3 inline_vload_half3(size_t i, const __global half *p)
{
    const __global short *bits = (const __global short *)p + 3 * i;
    const short4 three = (short4)(bits[0], bits[1], bits[2], (short)0);
    const float4 each = __builtin_ia32_vcvtph2ps((short8)(three, (short4)(0)));
    return each.xyz;
}
INLINE_BUILTIN void inline_vstore_half(float v, size_t i, __global half *p)
{
    const short8 bits = __builtin_ia32_vcvtps2ph((float4)(v), 0);
    ((__global short *)p)[i] = bits.s0;
}
#undef vload_half
#undef vload_half2
#undef vload_half3
#undef vload_half4
#undef vstore_half
#undef vstore_half2
#undef vstore_half4
#define vload_half(i, p) inline_vload_half(i, p)
#define vload_half3(i, p) inline_vload_half3(i, p)
#define vstore_half(v, i, p) inline_vstore_half(v, i, p)
#define vload_half2(i, p) inline_vload_half2(i, p)
#define vload_half4(i, p) inline_vload_half4(i, p)
#define vstore_half2(v, i, p) inline_vstore_half2(v, i, p)
#define vstore_half4(v, i, p) inline_vstore_half4(v, i, p)
#endif

#undef INLINE_BUILTIN
#undef INLINE_ORDERED
#undef INLINE_ORDERED_BY_NUMBERS
#undef INLINE_FLOATS
#undef INLINE_FLOATS_BY_NUMBERS
#undef INLINE_GEOMETRY
#undef INLINE_CONVERTED
#undef INLINE_ALL_CONVERTED
#undef INLINE_IN_SPACE
#undef INLINE_THREE_IN_SPACE
#undef INLINE_IN_MEMORY
#undef INLINE_ALL_IN_MEMORY

#define min(a, b) inline_min(a, b)
#define max(a, b) inline_max(a, b)
#define clamp(x, low, high) inline_clamp(x, low, high)
#define mix(a, b, t) inline_mix(a, b, t)
#define fmin(a, b) inline_fmin(a, b)
#define fmax(a, b) inline_fmax(a, b)
#define fabs(x) inline_fabs(x)
#define floor(x) inline_floor(x)
#define ceil(x) inline_ceil(x)
#define sqrt(x) inline_sqrt(x)
#define rsqrt(x) inline_rsqrt(x)
#define copysign(a, b) inline_copysign(a, b)
#define smoothstep(low, high, x) inline_smoothstep(low, high, x)
#define dot(a, b) inline_dot(a, b)
#define cross(a, b) inline_cross(a, b)
#define length(x) inline_length(x)
#define distance(a, b) inline_distance(a, b)
#define normalize(x) inline_normalize(x)
#define select(a, b, c) ((c) ? (b) : (a))
#define any(x) inline_any(x)
#define convert_float(x) ((float)(x))
#define convert_int(x) ((int)(x))
#define convert_float2(v) inline_float2(v)
#define convert_float3(v) inline_float3(v)
#define convert_float4(v) inline_float4(v)
#define convert_int2(v) inline_int2(v)
#define convert_int3(v) inline_int3(v)
#define convert_int4(v) inline_int4(v)
#define convert_int3_sat(v) inline_int3_sat(v)
#define convert_int3_rtn(v) inline_int3(inline_floor(v))
#define convert_float8(v) inline_float8(v)
#define convert_float16(v) inline_float16(v)
#define convert_int8(v) inline_int8(v)
#define convert_int16(v) inline_int16(v)
#define clz(x) inline_clz(x)
#define vload2(i, p) inline_vload2(i, p)
#define vload3(i, p) inline_vload3(i, p)
#define vload4(i, p) inline_vload4(i, p)
#define vload8(i, p) inline_vload8(i, p)
#define vload16(i, p) inline_vload16(i, p)
#define vstore2(v, i, p) inline_vstore2(v, i, p)
#define vstore3(v, i, p) inline_vstore3(v, i, p)
#define vstore4(v, i, p) inline_vstore4(v, i, p)
#define vstore8(v, i, p) inline_vstore8(v, i, p)
#define vstore16(v, i, p) inline_vstore16(v, i, p)

#endif
#endif

#endif
