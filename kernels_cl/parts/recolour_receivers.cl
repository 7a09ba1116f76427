// Receivers whose materials change (parts/recolour.cl). albedo, emission: (receivers, 3).
#include "common/vec.cl"

#define STORE_PARAMS __global float *albedo, __global float *emission
#define STORE_ARGS albedo, emission
inline void store_colours(STORE_PARAMS, int place, float3 a, float3 e)
{
    store3(albedo, place, a);
    store3(emission, place, e);
}
#include "parts/recolour.cl"
