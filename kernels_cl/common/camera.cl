// The pinhole camera: 12 floats, written by gibench.techniques.parts.camera_table:
//   0-2 position, 3-5 unit forward, 6-8 half the image's width at distance 1 to the right,
//   9-11 half its height upwards.
#ifndef GIBENCH_CAMERA
#define GIBENCH_CAMERA

#include "common/vec.cl"

typedef struct {
    float3 origin;
    float3 direction; // unit
} Ray;

// The ray through the centre of `pixel`; pixel (0, 0) is the image's upper left.
inline Ray primary_ray(__global const float *camera, int2 pixel, int width, int height)
{
    const float x = (pixel.x + 0.5f) / width * 2.0f - 1.0f;
    const float y = 1.0f - (pixel.y + 0.5f) / height * 2.0f;
    Ray ray;
    ray.origin = load3(camera, 0);
    ray.direction = normalize(load3(camera, 1) + x * load3(camera, 2) + y * load3(camera, 3));
    return ray;
}

#endif
