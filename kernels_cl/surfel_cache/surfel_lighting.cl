// What the surfels send out: the leaves of the hierarchy.
#include "common/bvh.cl"
#include "common/lights.cl"
#include "common/octahedral.cl"
#include "common/vec.cl"
#include "surfel_cache/caches.cl"
#include "surfel_cache/shared_exponent.cl"

// surfel_lighting: one work-item per surfel.
//   flux = area (pi emission + albedo (direct irradiance + the caches' of the last frame))
// with shadow rays for the direct part; the caches' part is left out when bounces is 0. Jendersie et
// al. 2016, section 3 and figure 2, steps 2 and 5. Flux is told over one surfel's area and times
// flux_scale, a power of two.
// surfel_place: position, m, and the node that the surfel is (an int); surfel_normal: shading normal,
// octahedral, two snorm16; surfel_albedo: three times 10 bits; surfel_emission: shared exponent,
// W/m2/sr; surfel_uv: place in the map over its size, two unorm16; NO_PLACE, a macro, where it has none.
__kernel void surfel_lighting(BVH_PARAMS, LIGHT_PARAMS, CACHE_PARAMS,
                              __global const float4 *surfel_place,
                              __global const uint *surfel_normal,
                              __global const uint *surfel_albedo,
                              __global const uint *surfel_emission,
                              __global const uint *surfel_uv, int count, int bounces,
                              float flux_scale, __global uint *node_flux)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const float4 place = surfel_place[i];
    const float3 position = place.xyz;
    const uint packed = surfel_normal[i];
    const float3 n = octahedral_unpacked(packed);
    float3 irradiance = direct_irradiance(BVH_ARGS, LIGHT_ARGS, position, n, n);
    if (bounces) {
        const Lobe diffuse = lobe_towards(n, DIFFUSE_BANDS);
        const uint uv = surfel_uv[i];
        float2 at = (float2)(-1.0f);
        if (uv != NO_PLACE)
            at = (float2)((float)(uv & 0xffffu) * (float)cache_width,
                          (float)(uv >> 16) * (float)cache_height) / 65535.0f;
        irradiance += PI_F * gathered_light(CACHE_ARGS, at, position, &diffuse);
    }
    const uint a = surfel_albedo[i];
    const float3 albedo =
        (float3)((float)(a & 1023u), (float)(a >> 10 & 1023u), (float)(a >> 20 & 1023u)) / 1023.0f;
    const float3 radiosity = PI_F * shared_decode(surfel_emission[i]) + albedo * irradiance;
    node_flux[as_int(place.w)] = shared_encode(radiosity * flux_scale);
}
