// Small vector helpers shared by every kernel.
#ifndef GIBENCH_VEC
#define GIBENCH_VEC

#define PI_F 3.14159265358979f
#define INV_PI_F 0.318309886183791f

inline float3 load3(__global const float *p, size_t i)
{
    return (float3)(p[3 * i], p[3 * i + 1], p[3 * i + 2]);
}

inline void store3(__global float *p, size_t i, float3 v)
{
    p[3 * i] = v.x;
    p[3 * i + 1] = v.y;
    p[3 * i + 2] = v.z;
}

// An orthonormal basis around a unit normal without branches on its direction
// (Duff et al. 2017, "Building an Orthonormal Basis, Revisited", listing 3).
inline void orthonormal_basis(float3 n, float3 *t, float3 *b)
{
    const float s = copysign(1.0f, n.z);
    const float a = -1.0f / (s + n.z);
    const float c = n.x * n.y * a;
    *t = (float3)(1.0f + s * n.x * n.x * a, s * c, -s * n.x);
    *b = (float3)(c, s + n.y * n.y * a, -n.y);
}

#endif
