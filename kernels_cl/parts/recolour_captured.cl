// Captured texels whose materials change (parts/recolour.cl). captured_albedo, captured_emission: texels
// of 4, the last not used.
#include "common/vec.cl"

#define STORE_PARAMS __global half *captured_albedo, __global half *captured_emission
#define STORE_ARGS captured_albedo, captured_emission
inline void store_colours(STORE_PARAMS, int place, float3 a, float3 e)
{
    vstore_half4((float4)(a, 0.0f), place, captured_albedo);
    vstore_half4((float4)(e, 0.0f), place, captured_emission);
}
#include "parts/recolour.cl"
