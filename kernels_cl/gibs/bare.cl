// Where surfels' rays hit bare surface: what tracing leaves for placement. Of the rays that do so in
// a cell of the grid one is taken, chosen at random, whatever order they ran in. Rays shorter than
// their surfel's radius are passed over: in a crack depth tests leave no surfel more than the crack's
// width to cover, and no number of them fills it. Ours.
#ifndef GIBENCH_GIBS_BARE
#define GIBENCH_GIBS_BARE

#include "gibs/frame.cl"

// Coverage as it is compared.
inline uint coverage_steps(float coverage)
{
    return min(convert_uint_sat_rte(coverage * COVERAGE_STEPS), COVERAGE_MOST);
}

// bare      coverage, in steps, under which a surface is bare
// ray_hit   (rays,) of rays that hit it: triangle (an int) and barycentrics
// cell_ray  (GRID_CELLS,) the least key among them, NO_RAY where there is none
#if BY_RAYS
#define BARE_PARAMS uint bare, __global float4 *ray_hit, __global uint *cell_ray,
#else
#define BARE_PARAMS
#endif

// A number for each ray, one to one, in an order that changes with the frame: KEY_INVERSE times KEY_FACTOR
// is 1 modulo 2^32.
inline uint key_mask(__global const uint *frame)
{
    return random_words(frame[FRAME_SEED], frame[FRAME_NUMBER], 0xba4eu).x;
}

inline uint ray_key(__global const uint *frame, uint ray)
{
    return (ray ^ key_mask(frame)) * KEY_FACTOR;
}

inline uint ray_of_key(__global const uint *frame, uint key)
{
    return (key * KEY_INVERSE) ^ key_mask(frame);
}

#endif
