// Surfels whose materials change (parts/recolour.cl). surfel_albedo, surfel_emission: as
// surfel_cache/surfel_lighting.cl reads them.
#include "common/vec.cl"
#include "surfel_cache/shared_exponent.cl"

#define STORE_PARAMS __global uint *surfel_albedo, __global uint *surfel_emission
#define STORE_ARGS surfel_albedo, surfel_emission
inline void store_colours(STORE_PARAMS, int place, float3 a, float3 e)
{
    const float3 q = rint(clamp(a, 0.0f, 1.0f) * 1023.0f);
    surfel_albedo[place] = (uint)q.x | (uint)q.y << 10 | (uint)q.z << 20;
    surfel_emission[place] = shared_encode(e);
}
#include "parts/recolour.cl"
