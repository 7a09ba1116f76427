// What caches hold, and its lookup: incident radiance in spherical harmonics.
//
// cache_map   for each texel of the caches' light map, row by row, what
//             surfel_cache/coefficients.cl says
// cache_grid  the same for each cell of the grid (parts/probe_volume.cl's order, without a scroll)
// grid        6 floats: the first cell's cache, m, and the spacing, m
// Macros: BANDS (2 to 4), GRID_X, GRID_Y, GRID_Z, VEC 1.
#ifndef GIBENCH_SURFEL_CACHES
#define GIBENCH_SURFEL_CACHES

#include "common/vec.cl"

#include "surfel_cache/coefficients.cl"

#include "common/sh.cl"

#define CACHE_PARAMS                                                               \
    __global const ushort *cache_map, int cache_width, int cache_height,            \
        __global const ushort *cache_grid, __global const float *grid
#define CACHE_ARGS cache_map, cache_width, cache_height, cache_grid, grid

inline float4 cache_coefficient(__global const ushort *caches, size_t cache, int j)
{
    return vload_half4(cache * COEFFICIENTS + j, (__global const half *)caches);
}

// A lobe (Jendersie et al. 2016, equations 8 and 12): the basis in its direction, each band weighed.
typedef struct {
    float terms[COEFFICIENTS];
} Lobe;

inline Lobe lobe_towards(float3 direction, float4 bands)
{
    Lobe lobe;
    for (int j = 0; j < COEFFICIENTS; ++j)
        lobe.terms[j] = 0.0f;
    sh_accumulate(direction.x, direction.y, direction.z, 1.0f, lobe.terms);
    lobe.terms[0] *= bands.x;
    for (int j = 1; j < 4; ++j)
        lobe.terms[j] *= bands.y;
#if BANDS > 2
    for (int j = 4; j < 9; ++j)
        lobe.terms[j] *= bands.z;
#endif
#if BANDS > 3
    for (int j = 9; j < 16; ++j)
        lobe.terms[j] *= bands.w;
#endif
    return lobe;
}

// The bands of a lobe of volume one about the normal: a diffuse surface's over pi (exponent 1).
#define DIFFUSE_BANDS (float4)(1.0f, 2.0f / 3.0f, 0.25f, 0.0f)

// Those of a lobe cos^n (equations 11 and 12).
inline float4 lobe_bands(float n)
{
    const float first = (n + 1.0f) / (n + 2.0f);
    return (float4)(1.0f, first, n / (n + 3.0f), first * (n - 1.0f) / (n + 4.0f));
}

// Sums over caches, and their weights.
typedef struct {
    float3 light;
    float weight;
} Gathered;

// Equation 5 of one cache, by a weight, where there is one.
inline void gather(Gathered *sum, __global const ushort *caches, size_t cache, float weight,
                   const Lobe *lobe)
{
    const float4 first = cache_coefficient(caches, cache, 0);
    if (first.w <= 0.0f || weight <= 0.0f)
        return;
    float3 light = first.xyz * lobe->terms[0];
    for (int j = 1; j < COEFFICIENTS; ++j)
        light += cache_coefficient(caches, cache, j).xyz * lobe->terms[j];
    sum->light += weight * light;
    sum->weight += weight;
}

// From the map, bilinear, at a place in texels; false where no texel around it holds anything.
inline bool light_of_map(__global const ushort *cache_map, int width, int height, float2 at,
                         const Lobe *lobe, float3 *light)
{
    const float x = at.x - 0.5f, y = at.y - 0.5f;
    const float x_floor = floor(x), y_floor = floor(y);
    const float fx = x - x_floor, fy = y - y_floor;
    const int x0 = clamp((int)x_floor, 0, width - 1), x1 = clamp((int)x_floor + 1, 0, width - 1);
    const int y0 = clamp((int)y_floor, 0, height - 1), y1 = clamp((int)y_floor + 1, 0, height - 1);
    Gathered sum = {(float3)(0.0f), 0.0f};
    // A loop: written out four times, with four bands, Intel's compiler 2026.22 loses the red of it.
    for (int row = 0; row < 2; ++row) {
        const size_t first = (size_t)(row ? y1 : y0) * width;
        const float share = row ? fy : 1.0f - fy;
        gather(&sum, cache_map, first + x0, (1.0f - fx) * share, lobe);
        gather(&sum, cache_map, first + x1, fx * share, lobe);
    }
    if (sum.weight <= 0.0f)
        return false;
    *light = sum.light / sum.weight;
    return true;
}

// From the grid, trilinear; caches inside geometry, which are not lit, do not count.
inline float3 light_of_grid(__global const ushort *cache_grid, __global const float *grid,
                            float3 position, const Lobe *lobe)
{
    const float3 most = (float3)(GRID_X - 1, GRID_Y - 1, GRID_Z - 1);
    const float3 at = fmin(fmax((position - load3(grid, 0)) / load3(grid, 1), (float3)(0.0f)), most);
    const float3 low = fmin(floor(at), fmax(most - 1.0f, (float3)(0.0f)));
    const float3 share = at - low;
    const int x = (int)low.x, y = (int)low.y, z = (int)low.z;
    Gathered sum = {(float3)(0.0f), 0.0f};
    for (int corner = 0; corner < 8; ++corner) {
        const int dx = corner & 1, dy = corner >> 1 & 1, dz = corner >> 2;
        const float weight = (dx ? share.x : 1.0f - share.x) * (dy ? share.y : 1.0f - share.y) *
                             (dz ? share.z : 1.0f - share.z);
        if (weight > 0.0f)
            gather(&sum, cache_grid, ((size_t)(z + dz) * GRID_Y + y + dy) * GRID_X + x + dx, weight,
                   lobe);
    }
    return sum.weight > 0.0f ? sum.light / sum.weight : (float3)(0.0f);
}

// What a lobe gathers at a point: from the map where it has a place there (not negative), else from
// the grid. The harmonics ring: less than nothing is nothing.
inline float3 gathered_light(CACHE_PARAMS, float2 place, float3 position, const Lobe *lobe)
{
    float3 light;
    const bool placed = place.x >= 0.0f;
    if (!placed || !light_of_map(cache_map, cache_width, cache_height, place, lobe, &light))
        light = light_of_grid(cache_grid, grid, position, lobe);
    return fmax(light, (float3)(0.0f));
}

#endif
