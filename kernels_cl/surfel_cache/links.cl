// What both variants of cache lighting share.
//
// link_node      sender of each link
// link_light     stored (PROJECTION_STORED): BANDS^2 halves of each link
// link_direction at run time: octahedral direction from the cache, two snorm16
// link_weight    at run time: two halves, the first coefficient over y_0, and the solid angle, sr
// environment    (caches, BANDS^2, 3) halves, what of it each cache sees, W/m2/sr, with ENVIRONMENT
// cache_place    where each cache lies in the map or in the grid
// Macros: BANDS, PROJECTION, ENVIRONMENT, LINKS (room for each cache's links).
#ifndef GIBENCH_SURFEL_LINKS
#define GIBENCH_SURFEL_LINKS

#include "surfel_cache/coefficients.cl"

#include "common/sh.cl"
#include "surfel_cache/shared_exponent.cl"

#define PROJECTION_STORED 0
#define PROJECTION_RUNTIME 1

#if PROJECTION == PROJECTION_STORED
#define LINK_PARAMS __global const int *link_node, __global const ushort *link_light
#define LINK_ARGS link_node, link_light
#else
#define LINK_PARAMS                                                  \
    __global const int *link_node, __global const uint *link_direction, \
        __global const uint *link_weight
#define LINK_ARGS link_node, link_direction, link_weight
#endif

#if ENVIRONMENT
#define ENVIRONMENT_LIGHT_PARAM __global const ushort *environment,
#else
#define ENVIRONMENT_LIGHT_PARAM
#endif

#define TWO_PI_F 6.28318530717959f

// Writes a cache: the sums times unscale, and what it sees of the environment.
#if ENVIRONMENT
#define STORE_CACHE(j, sum)                                                                   \
    vstore_half4((float4)((sum) * unscale + vload_half3((size_t)cache * COEFFICIENTS + (j),   \
                                                        (__global const half *)environment), \
                          (j) == 0 ? CACHE_LIT : 0.0f),                                       \
                 (size_t)cache_place[cache] * COEFFICIENTS + (j), (__global half *)caches)
#else
#define STORE_CACHE(j, sum)                                                       \
    vstore_half4((float4)((sum) * unscale, (j) == 0 ? CACHE_LIT : 0.0f),          \
                 (size_t)cache_place[cache] * COEFFICIENTS + (j), (__global half *)caches)
#endif

#endif
