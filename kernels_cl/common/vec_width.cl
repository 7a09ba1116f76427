// Explicit vectors of VEC floats (2, 4, 8 or 16; scalars where VEC is 1 or not given); PoCL does not
// vectorise across work-items.
#ifndef GIBENCH_VEC_WIDTH
#define GIBENCH_VEC_WIDTH

#define VEC_JOIN_(a, b) a##b
#define VEC_JOIN(a, b) VEC_JOIN_(a, b)

#if VEC <= 1
typedef float vfloat;
typedef int vint;
typedef uint vuint;
#define vec_float_of(v) convert_float(v)
#define vec_int_of(v) convert_int(v)
#define vec_load(i, p) ((p)[i])
#define vec_store(v, i, p) ((p)[i] = (v))
#define vec_load_uchar(i, p) ((float)(p)[i])
#define vec_any(v) ((v) != 0.0f)
inline float vec_sum(float v)
{
    return v;
}
#else
typedef VEC_JOIN(float, VEC) vfloat;
typedef VEC_JOIN(int, VEC) vint;
typedef VEC_JOIN(uint, VEC) vuint;
#define vec_float_of(v) VEC_JOIN(convert_float, VEC)(v)
#define vec_int_of(v) VEC_JOIN(convert_int, VEC)(v)
#define vec_load(i, p) VEC_JOIN(vload, VEC)(i, p)
#define vec_store(v, i, p) VEC_JOIN(vstore, VEC)(v, i, p)
#define vec_load_uchar(i, p) VEC_JOIN(convert_float, VEC)(VEC_JOIN(vload, VEC)(i, p))
#define vec_any(v) any((v) != (vfloat)(0.0f))
inline float vec_sum(vfloat v)
{
    float sum = 0.0f;
    const float *lane = (const float *)&v;
    for (int i = 0; i < VEC; ++i)
        sum += lane[i];
    return sum;
}
#endif

#endif
