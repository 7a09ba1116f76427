// The builtins that kernels call, or are likely to, and builtins.cl does not have inline, declared
// for PoCL 3 as its own header does; begins every program (device/source.py), and is empty but for
// builds that leave that header out (device/build.py).
//
// The header, clang's opencl-c.h, declares every builtin for every type: 18,000 lines. To read them
// takes a tenth of a second in each program that is built and 20 ms in each that comes from PoCL's
// cache. A kernel that calls a builtin which is missing here is built with the header, as slowly
// as ever; tests say so (tests/support/shared_builds.py).
#ifndef GIBENCH_DECLARED
#define GIBENCH_DECLARED
#ifdef DECLARE_BUILTINS

#define DECLARED __attribute__((overloadable))
#define DECLARED_CONST __attribute__((overloadable, const))

// -- work-items -------------------------------------------------------------------------------

size_t DECLARED_CONST get_global_id(uint dimension);
size_t DECLARED_CONST get_global_size(uint dimension);
size_t DECLARED_CONST get_group_id(uint dimension);
size_t DECLARED_CONST get_local_id(uint dimension);
size_t DECLARED_CONST get_local_size(uint dimension);
size_t DECLARED_CONST get_num_groups(uint dimension);
void __attribute__((overloadable, convergent)) barrier(cl_mem_fence_flags flags);

// -- numbers and vectors of them --------------------------------------------------------------

#define DECLARED_OF_FLOATS(T) \
    T DECLARED_CONST acos(T x); \
    T DECLARED_CONST asin(T x); \
    T DECLARED_CONST atan(T x); \
    T DECLARED_CONST cos(T x); \
    T DECLARED_CONST exp(T x); \
    T DECLARED_CONST exp2(T x); \
    T DECLARED_CONST log(T x); \
    T DECLARED_CONST log2(T x); \
    T DECLARED_CONST rint(T x); \
    T DECLARED_CONST round(T x); \
    T DECLARED_CONST sign(T x); \
    T DECLARED_CONST sin(T x); \
    T DECLARED_CONST tan(T x); \
    T DECLARED_CONST trunc(T x); \
    T DECLARED_CONST atan2(T y, T x); \
    T DECLARED_CONST pow(T x, T y); \
    T DECLARED_CONST powr(T x, T y); \
    T DECLARED_CONST step(T edge, T x); \
    T DECLARED_CONST fma(T a, T b, T c);
DECLARED_OF_FLOATS(float)
DECLARED_OF_FLOATS(float2)
DECLARED_OF_FLOATS(float3)
DECLARED_OF_FLOATS(float4)
DECLARED_OF_FLOATS(float8)
DECLARED_OF_FLOATS(float16)
float2 DECLARED_CONST step(float edge, float2 x);
float3 DECLARED_CONST step(float edge, float3 x);
float4 DECLARED_CONST step(float edge, float4 x);
float8 DECLARED_CONST step(float edge, float8 x);
float16 DECLARED_CONST step(float edge, float16 x);

#define DECLARED_OF_INTS(T) int DECLARED_CONST all(T x);
DECLARED_OF_INTS(int)
DECLARED_OF_INTS(int2)
DECLARED_OF_INTS(int3)
DECLARED_OF_INTS(int4)
DECLARED_OF_INTS(int8)
DECLARED_OF_INTS(int16)

uint DECLARED_CONST convert_uint_sat_rte(float x);
int3 DECLARED_CONST convert_int3_rtz(float3 x);

// -- memory -----------------------------------------------------------------------------------

#define DECLARED_ATOMICS(SPACE, T) \
    T DECLARED atomic_add(volatile SPACE T *p, T value); \
    T DECLARED atomic_max(volatile SPACE T *p, T value); \
    T DECLARED atomic_min(volatile SPACE T *p, T value); \
    T DECLARED atomic_inc(volatile SPACE T *p); \
    T DECLARED atomic_dec(volatile SPACE T *p);
DECLARED_ATOMICS(__global, int)
DECLARED_ATOMICS(__global, uint)
DECLARED_ATOMICS(__local, int)
DECLARED_ATOMICS(__local, uint)

#define DECLARED_LOAD __attribute__((overloadable, pure))
#define DECLARED_HALVES(SPACE) \
    float DECLARED_LOAD vload_half(size_t i, const SPACE half *p); \
    float2 DECLARED_LOAD vload_half2(size_t i, const SPACE half *p); \
    float3 DECLARED_LOAD vload_half3(size_t i, const SPACE half *p); \
    float4 DECLARED_LOAD vload_half4(size_t i, const SPACE half *p); \
    void DECLARED vstore_half(float v, size_t i, SPACE half *p); \
    void DECLARED vstore_half2(float2 v, size_t i, SPACE half *p); \
    void DECLARED vstore_half3(float3 v, size_t i, SPACE half *p); \
    void DECLARED vstore_half4(float4 v, size_t i, SPACE half *p);
DECLARED_HALVES(__global)
DECLARED_HALVES(__local)

#undef DECLARED
#undef DECLARED_CONST
#undef DECLARED_OF_FLOATS
#undef DECLARED_OF_INTS
#undef DECLARED_ATOMICS
#undef DECLARED_LOAD
#undef DECLARED_HALVES

#endif
#endif
