// Indirect light from a lightmap on what the camera sees.
#include "common/lightmap.cl"

#define LOOKUP_PARAMS LIGHTMAP_PARAMS
#define LOOKUP_ARGS LIGHTMAP_ARGS
inline float3 looked_up(LOOKUP_PARAMS, Hit hit, float3 direction)
{
    return lightmap_irradiance(LIGHTMAP_ARGS, hit);
}
#include "parts/apply.cl"
