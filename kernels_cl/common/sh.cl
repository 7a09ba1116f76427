// Real spherical harmonics up to order 7 on vectors of VEC directions.
// Index j = l (l + 1) + m, z the polar axis, orthonormal, no Condon-Shortley phase; the same
// recurrences as gibench/techniques/srp/bake/sh.py (Sloan 2013, "Efficient Spherical Harmonic
// Evaluation").
// Macros: VEC (1, 2, 4, 8 or 16 floats per vector), SH_ORDER (0 to 7).
#ifndef GIBENCH_SH
#define GIBENCH_SH

#include "common/vec_width.cl"

#define SH_COUNT ((SH_ORDER + 1) * (SH_ORDER + 1))

// P_m^m without sin^m, times sqrt(2) for m > 0.
__constant float SH_DIAGONAL[8] = {
    0.282094792f, 0.488602512f, 0.546274215f, 0.590043590f,
    0.625835735f, 0.656382057f, 0.683184105f, 0.707162733f
};

// P_l^m = SH_A z P_{l-1}^m - SH_B P_{l-2}^m; entry l (l + 1) / 2 + m.
__constant float SH_A[36] = {
    0.00000000f,
    1.73205081f, 0.00000000f,
    1.93649167f, 2.23606798f, 0.00000000f,
    1.97202659f, 2.09165007f, 2.64575131f, 0.00000000f,
    1.98431348f, 2.04939015f, 2.29128785f, 3.00000000f, 0.00000000f,
    1.98997487f, 2.03100960f, 2.17124059f, 2.48746859f, 3.31662479f, 0.00000000f,
    1.99304346f, 2.02131499f, 2.11394182f, 2.30136835f, 2.67394839f, 3.60555128f, 0.00000000f,
    1.99489143f, 2.01556444f, 2.08166600f, 2.20794022f, 2.43086217f, 2.85043856f, 3.87298335f, 0.00000000f
};
__constant float SH_B[36] = {
    0.00000000f,
    0.00000000f, 0.00000000f,
    1.11803399f, 0.00000000f, 0.00000000f,
    1.01835015f, 0.935414347f, 0.00000000f, 0.00000000f,
    1.00623059f, 0.979795897f, 0.866025404f, 0.00000000f, 0.00000000f,
    1.00285307f, 0.991031209f, 0.947607083f, 0.829156198f, 0.00000000f, 0.00000000f,
    1.00154202f, 0.995226703f, 0.973610120f, 0.925184889f, 0.806225775f, 0.00000000f, 0.00000000f,
    1.00092721f, 0.997155044f, 0.984731928f, 0.959403224f, 0.909090909f, 0.790569415f, 0.00000000f, 0.00000000f
};

// sums[j] += weight * Y_j(x, y, z) for every j below SH_COUNT; the direction is unit length.
inline void sh_accumulate(vfloat x, vfloat y, vfloat z, vfloat weight, vfloat *sums)
{
    vfloat cosine = weight;
    vfloat sine = (vfloat)(0.0f);
#pragma unroll
    for (int m = 0; m <= SH_ORDER; ++m) {
        if (m > 0) {
            const vfloat next = x * cosine - y * sine;
            sine = x * sine + y * cosine;
            cosine = next;
        }
        vfloat before = (vfloat)(0.0f);
        vfloat legendre = (vfloat)(SH_DIAGONAL[m]);
#pragma unroll
        for (int l = m; l <= SH_ORDER; ++l) {
            if (l > m) {
                const int at = l * (l + 1) / 2 + m;
                const vfloat next = SH_A[at] * z * legendre - SH_B[at] * before;
                before = legendre;
                legendre = next;
            }
            sums[l * (l + 1) + m] += legendre * cosine;
            if (m > 0)
                sums[l * (l + 1) - m] += legendre * sine;
        }
    }
}

#endif
