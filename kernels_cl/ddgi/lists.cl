// Lists of the rays that count for a texel, the same for all probes of a frame.
//
// Of every texel LIST_LENGTH places: the rays whose cosine with the texel's direction is above `least`, in
// their order, and their weights, which are the cosine itself, or the power of it that distances are
// weighed by where `sharp`. Macro: LIST_STEP; entries are added so many at a time, and lists are filled up
// with rays of weight 0.
#ifndef GIBENCH_DDGI_LISTS
#define GIBENCH_DDGI_LISTS

#include "ddgi/rays.cl"
#include "ddgi/texel.cl"

#define LIST_LENGTH ((BLENDED + LIST_STEP - 1) / LIST_STEP * LIST_STEP)

// The list of one texel; returns its length, a multiple of LIST_STEP.
inline int make_list(int texel, int side, int sharp, float least, __global const float *directions,
                     __global int *list_rays, __global float *list_weights)
{
    const float3 towards = texel_direction(texel, side);
    const float east = towards.x, north = towards.y, up = towards.z;
    __global int *own_rays = list_rays + (size_t)texel * LIST_LENGTH;
    __global float *own_weights = list_weights + (size_t)texel * LIST_LENGTH;
    int length = 0;
    for (int ray = 0; ray < BLENDED; ++ray) {
        // Not dot(): Intel's compiler makes a call of it for each work-item of a vector.
        __global const float *d = directions + 3 * (FIXED + ray);
        const float cosine = east * d[0] + north * d[1] + up * d[2];
        if (cosine > least) {
            own_rays[length] = ray;
            own_weights[length] = sharp ? cosine_power(cosine) : cosine;
            ++length;
        }
    }
    for (; length % LIST_STEP; ++length) {
        own_rays[length] = 0;
        own_weights[length] = 0.0f;
    }
    return length;
}

#endif
