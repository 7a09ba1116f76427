// Radiance from infinitely far away, an equirectangular image (gibench.scene.model.Environment).
#ifndef GIBENCH_ENVIRONMENT
#define GIBENCH_ENVIRONMENT

#include "common/vec.cl"

#define ENVIRONMENT_PARAMS \
    __global const float *environment, int environment_width, int environment_height
#define ENVIRONMENT_ARGS environment, environment_width, environment_height

// Radiance, W/m2/sr, from the unit direction `d`: bilinear at pixel centres, wrapping in azimuth,
// clamped in elevation. Row 0 is +Y; azimuth = atan2(x, -z) starts at -pi in column 0.
inline float3 environment_radiance(ENVIRONMENT_PARAMS, float3 d)
{
    const float azimuth = atan2(d.x, -d.z);
    const float x = (azimuth * (0.5f * INV_PI_F) + 0.5f) * environment_width - 0.5f;
    const float y = acos(clamp(d.y, -1.0f, 1.0f)) * INV_PI_F * environment_height - 0.5f;
    const float x_floor = floor(x), y_floor = floor(y);
    const float fx = x - x_floor, fy = y - y_floor;
    const int x0 = ((int)x_floor + environment_width) % environment_width;
    const int x1 = (x0 + 1) % environment_width;
    const int y0 = clamp((int)y_floor, 0, environment_height - 1);
    const int y1 = clamp((int)y_floor + 1, 0, environment_height - 1);
    const size_t top = (size_t)y0 * environment_width, bottom = (size_t)y1 * environment_width;
    return mix(mix(load3(environment, top + x0), load3(environment, top + x1), fx),
               mix(load3(environment, bottom + x0), load3(environment, bottom + x1), fx), fy);
}

#endif
