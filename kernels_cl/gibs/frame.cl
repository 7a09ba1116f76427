// What changes with the frame, and the counters of the surfels' life.
#ifndef GIBENCH_GIBS_FRAME
#define GIBENCH_GIBS_FRAME

// frame: words written by gibench.techniques.gibs.technique before every frame.
#define FRAME_ALIVE 0      // surfels alive when the frame begins
#define FRAME_NUMBER 1     // frames begun so far, from 1
#define FRAME_RAYS 2       // rays to trace in this frame
#define FRAME_SEED 3       // of every random choice
#define FRAME_CAMERA 4     // camera position, three floats
#define FRAME_ANGLE 7      // a surfel's radius per metre from the camera, float
#define FRAME_MIN_RADIUS 8 // m, float
#define FRAME_MAX_RADIUS 9 // m, float
#define FRAME_WORDS 10

// counters: words that only the device writes.
#define COUNT_ALIVE 0     // surfels alive
#define COUNT_FREE 1      // height of the stack of free IDs
#define COUNT_PLACED 2    // placed in this frame
#define COUNT_RECYCLED 3  // recycled in this frame
#define COUNT_SURVIVORS 4 // alive after this frame
#define COUNT_WORDS 5

// packed: PACKED_ROWS rows of PACKED_STRIDE floats, an entry of the grid's lists per column:
// position, normal, 1 / radius, irradiance, least mean depth. Beyond the entries, room for one vector.
#define PACKED_STRIDE (ENTRIES + 16)
#define PACKED_ROWS 11
#define PACKED_RADIUS 6
#define PACKED_IRRADIANCE 7
#define PACKED_NEAREST 10

inline float frame_float(__global const uint *frame, int word)
{
    return as_float(frame[word]);
}

inline float3 frame_camera(__global const uint *frame)
{
    return (float3)(as_float(frame[FRAME_CAMERA]), as_float(frame[FRAME_CAMERA + 1]),
                    as_float(frame[FRAME_CAMERA + 2]));
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

// Three well mixed words from three (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering",
// pcg3d).
inline uint3 random_words(uint a, uint b, uint c)
{
    uint3 v = (uint3)(a, b, c) * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> 16u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    return v;
}

// In [0, 1).
inline float unit_float(uint word)
{
    return (word >> 8) * (1.0f / 16777216.0f);
}

#endif
