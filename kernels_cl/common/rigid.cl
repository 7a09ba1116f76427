// Rigid transforms: rows of 12 floats, 3 x 4, row-major, object to world.
#ifndef GIBENCH_RIGID
#define GIBENCH_RIGID

// A transform's columns.
typedef struct {
    float3 x, y, z, origin;
} Rigid;

inline Rigid rigid_load(__global const float *transforms, int object)
{
    __global const float *m = transforms + 12 * object;
    Rigid r;
    r.x = (float3)(m[0], m[4], m[8]);
    r.y = (float3)(m[1], m[5], m[9]);
    r.z = (float3)(m[2], m[6], m[10]);
    r.origin = (float3)(m[3], m[7], m[11]);
    return r;
}

inline float3 rigid_point(const Rigid *r, float3 p)
{
    return r->x * p.x + r->y * p.y + r->z * p.z + r->origin;
}

inline float3 rigid_direction(const Rigid *r, float3 d)
{
    return r->x * d.x + r->y * d.y + r->z * d.z;
}

#endif
