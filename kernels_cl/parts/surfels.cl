// Surfels: structure of arrays, with room for CAPACITY of them, and what changes with the frame.
#ifndef GIBENCH_SURFELS
#define GIBENCH_SURFELS

// frame: words that the host writes before every frame (gibench.techniques.parts.surfels); a
// technique may keep more behind them.
#define SURFELS_ALIVE 0     // surfels alive when the frame begins
#define SURFEL_CAMERA 1     // camera position, three floats
#define SURFEL_ANGLE 4      // a surfel's radius per metre from the camera, float
#define SURFEL_MIN_RADIUS 5 // m, float
#define SURFEL_MAX_RADIUS 6 // m, float

inline float3 surfel_camera(__global const uint *frame)
{
    return (float3)(as_float(frame[SURFEL_CAMERA]), as_float(frame[SURFEL_CAMERA + 1]),
                    as_float(frame[SURFEL_CAMERA + 2]));
}

// The radius that keeps a surfel's size on screen, m, `away` metres from the camera.
inline float surfel_radius(__global const uint *frame, float away)
{
    return clamp(away * as_float(frame[SURFEL_ANGLE]), as_float(frame[SURFEL_MIN_RADIUS]),
                 as_float(frame[SURFEL_MAX_RADIUS]));
}

// Structure of arrays: component c of surfel id lies at c * CAPACITY + id.
inline float3 surfel_load3(__global const float *array, uint id)
{
    return (float3)(array[id], array[CAPACITY + id], array[2 * CAPACITY + id]);
}

inline void surfel_store3(__global float *array, uint id, float3 v)
{
    array[id] = v.x;
    array[CAPACITY + id] = v.y;
    array[2 * CAPACITY + id] = v.z;
}

#endif
