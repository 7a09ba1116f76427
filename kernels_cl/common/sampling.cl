// Where rays start. RAY_SCALE is what lengths of our own are multiplied with in scenes of millimetres
// (gibench/rays/offset.py).
#ifndef GIBENCH_SAMPLING
#define GIBENCH_SAMPLING

#include "common/vec.cl"

// One coordinate moved 256 units in the last place along the normal, or by a fixed step near 0.
inline float offset_coordinate(float p, float n)
{
    const int step = (int)(256.0f * n);
    const float moved = as_float(as_int(p) + (p < 0.0f ? -step : step));
    return fabs(p) < RAY_SCALE * (1.0f / 32.0f) ? p + n * (RAY_SCALE / 65536.0f) : moved;
}

// A ray's origin moved off its surface so that the ray does not meet the surface again
// (Waechter and Binder 2019, "A Fast and Robust Method for Avoiding Self-Intersection",
// listing 6.1; `normal` points to the side the ray leaves on).
inline float3 offset_from_surface(float3 position, float3 normal)
{
    return (float3)(offset_coordinate(position.x, normal.x),
                    offset_coordinate(position.y, normal.y),
                    offset_coordinate(position.z, normal.z));
}

// A hit moved back along the ray that found it, by 256 units in the last place of its largest
// coordinate. A hit in a concave corner can round onto the corner itself, where a shadow ray starts
// in the plane of the other surface and slips past it; the way back is known to be free.
inline float3 back_along_ray(float3 position, float3 direction)
{
    const float3 size = fabs(position);
    const float step = 256.0f * 1.1920929e-7f * fmax(fmax(size.x, size.y), fmax(size.z, RAY_SCALE / 32));
    return position - step * direction;
}

#endif
