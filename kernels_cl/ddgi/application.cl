// The probes' light where it is wanted: at the camera's pixels, at the lightmap's receivers, and on
// little spheres that show the probes themselves.
#include "common/bvh.cl"
#include "common/camera.cl"
#include "common/material.cl"
#include "common/pixels.cl"
#include "common/shade.cl"
#include "parts/probe_gather.cl"

// What application looks up at a pixel: the probes' irradiance, W/m2.
#define LOOKUP_PARAMS SHAPE_PARAMS, VOLUME_PARAMS, MAP_PARAMS
#define LOOKUP_ARGS SHAPE_ARGS, VOLUME_ARGS, MAP_ARGS
inline float3 looked_up(LOOKUP_PARAMS, Hit hit, float3 direction)
{
    const Surface s = surface_shape(SHAPE_ARGS, hit);
    return gathered_irradiance(VOLUME_ARGS, MAP_ARGS, s.position,
                               surface_bias(volume, s.geometric_normal, -direction), s.normal);
}
#include "parts/apply.cl"

// receiver_irradiance: one work-item per receiver; irradiance: (count, 3) W/m2.
//   The gather where no camera looks: as seen along the normal.
__kernel void receiver_irradiance(VOLUME_PARAMS, MAP_PARAMS, __global const float *position,
                                  __global const float *normal, int count,
                                  __global float *irradiance)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const float3 n = load3(normal, i);
    store3(irradiance, i,
           gathered_irradiance(VOLUME_ARGS, MAP_ARGS, load3(position, i), surface_bias(volume, n, n), n));
}

// The irradiance that a usable probe holds for a direction, W/m2.
inline float3 stored_irradiance(__global const map_t *irradiance_maps, int probe, float3 direction)
{
    float2 f;
    const int corner = map_corner(direction, IRRADIANCE_SIDE, &f);
    const size_t first = (size_t)probe * IRRADIANCE_MAP + corner;
    return 2.0f * PI_F * averaged(irradiance_term(irradiance_maps, first, f).xyz);
}

// probe_view: one work-item per pixel; draws the probes over an image.
//   A sphere's point with normal n shows what a white surface of that normal would send out; an
//   inactive probe is drawn in dark red. Rays walk the cells around the grid's points (Amanatides
//   and Woo 1987); a sphere that its offset pushes over its cell's border is cut there.
// radius: m, less than half a spacing.
__kernel void probe_view(BVH_PARAMS, __global const float *camera, int width, int height,
                         VOLUME_PARAMS, __global const map_t *irradiance_maps, float radius,
                         __global float *image)
{
    const int2 pixel = tiled_pixel(get_global_id(0), width);
    if (pixel.x >= width || pixel.y >= height)
        return;
    const Ray ray = primary_ray(camera, pixel, width, height);
    const float limit = bvh_closest(BVH_ARGS, ray.origin, ray.direction, INFINITY).t;
    // In cells: cell c holds the points from c to c + 1, its probe's grid point in its middle.
    const float3 spacing = load3(volume, 1);
    const float3 origin = (ray.origin - load3(volume, 0)) / spacing + 0.5f;
    const float3 along = ray.direction / spacing;
    const float3 inverse = 1.0f / copysign(fmax(fabs(along), 1e-12f), along);
    const float3 counts = (float3)(PROBES_X, PROBES_Y, PROBES_Z);
    const float3 low = -origin * inverse, high = (counts - origin) * inverse;
    const float3 enter = fmin(low, high), leave = fmax(low, high);
    float t = fmax(fmax(enter.x, enter.y), fmax(enter.z, 0.0f));
    const float end = fmin(fmin(leave.x, leave.y), fmin(leave.z, limit));
    const int3 last = (int3)(PROBES_X - 1, PROBES_Y - 1, PROBES_Z - 1);
    int3 cell = clamp(convert_int3_rtn(origin + t * along), (int3)(0), last);
    while (t < end) {
        const float3 border = convert_float3(cell) + (along >= 0.0f ? (float3)(1.0f) : (float3)(0.0f));
        const float3 next = (border - origin) * inverse;
        const float exit = fmin(next.x, fmin(next.y, next.z));
        const int probe = probe_index(volume, cell);
        const float3 centre = probe_position(VOLUME_ARGS, probe) - ray.origin;
        const float middle = dot(centre, ray.direction);
        // From the ray's nearest point: the difference of two squares would lose a small sphere's digits.
        const float3 beside = centre - middle * ray.direction;
        const float inside = radius * radius - dot(beside, beside);
        const float hit = middle - sqrt(fmax(inside, 0.0f));
        if (inside > 0.0f && hit >= t && hit < fmin(exit, end)) {
            const float3 normal = normalize(hit * ray.direction - centre);
            float3 shown = (float3)(0.05f, 0.0f, 0.0f);
            if (probe_state(probe_data, probe) == (PROBE_ACTIVE | PROBE_BLENDED))
                shown = diffuse_reflectance((float3)(1.0f)) *
                        stored_irradiance(irradiance_maps, probe, normal);
            store3(image, (size_t)pixel.y * width + pixel.x, shown);
            return;
        }
        if (next.x <= exit)
            cell.x += along.x >= 0.0f ? 1 : -1;
        else if (next.y <= exit)
            cell.y += along.y >= 0.0f ? 1 : -1;
        else
            cell.z += along.z >= 0.0f ? 1 : -1;
        if (any(cell < 0) || any(cell > last))
            return;
        t = fmax(t, exit);
    }
}
