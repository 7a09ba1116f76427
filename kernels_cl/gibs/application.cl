// The surfels' light on what the camera sees (Ekberg 2022, sections 3.1.4 and 4.4).
#include "common/pixels.cl"
#include "common/shade.cl"
#include "gibs/gather.cl"

// Application marks the surfels of every pixel once in so many frames, another pixel of each 4 x 4
// block every frame: a visible surfel covers far more pixels than that.
#define MARKED_SIDE 4

// application: one work-item per pixel, in tiled order (common/pixels.cl).
// g_position, g_normal, g_albedo: as parts/gbuffer.cl keeps a surface. direct: the image of parts/camera.cl.
// indirect: (pixels,) indirect irradiance, W/m2, and coverage. image: (pixels, 3) direct light and
// what the surface makes of the indirect, W/m2/sr. seen: (CAPACITY,) the frame each surfel was last
// seen in.
__kernel void application(__global const uint *frame, GATHER_PARAMS, int width, int height,
                          __global const float4 *g_position, __global const float4 *g_normal,
                          __global const float4 *g_albedo, __global const float *direct,
                          __global uint *seen, __global float4 *indirect, __global float *image)
{
    const int2 pixel = tiled_pixel(get_global_id(0), width);
    if (pixel.x >= width || pixel.y >= height)
        return;
    const int at = pixel.y * width + pixel.x;
    const float4 position = g_position[at];
    float3 radiance = load3(direct, at);
    float4 result = (float4)(0.0f);
    if (as_int(position.w) != 0) {
        const uint number = frame[FRAME_NUMBER];
        const bool marks = pixel.x % MARKED_SIDE == number % MARKED_SIDE &&
                           pixel.y % MARKED_SIDE == number / MARKED_SIDE % MARKED_SIDE;
        const Gathered g = gather(GATHER_ARGS, position.xyz, g_normal[at].xyz,
                                  marks ? seen : (__global uint *)0, number);
        result = (float4)(g.irradiance, g.coverage);
        radiance = with_reflected(radiance, g_albedo[at].xyz, g.irradiance);
    }
    indirect[at] = result;
    store3(image, at, radiance);
}

// gather_points: one work-item per point; the indirect irradiance and the coverage at (count,)
// points, for receivers and tests.
__kernel void gather_points(GATHER_PARAMS, __global const float *position,
                            __global const float *normal, int count, __global float4 *indirect)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const Gathered g =
        gather(GATHER_ARGS, load3(position, i), load3(normal, i), (__global uint *)0, 0);
    indirect[i] = (float4)(g.irradiance, g.coverage);
}
