// All random numbers of a path, drawn ahead in vectors (drawing one takes more operations than most of
// what it is used for), and the directions that follow from them.
//
// Macros: GROUP, work-items per group. VEC, vertices that a work-item treats at once.
#ifndef GIBENCH_REFERENCE_DRAWS
#define GIBENCH_REFERENCE_DRAWS
#include "common/vec.cl"
#include "reference/sampler.cl"

// After this many vertices paths end by chance.
#define ROULETTE_AFTER 3

// What is drawn ahead: planes of `stride` numbers each in `drawn`. For every path, before it starts:
// which fragment of the receiver, and where on it (or in the pixel).
#define DRAWN_FRAGMENT 0
#define DRAWN_START 1
// For every vertex: a point on the emitters, a direction of the environment, and the end by chance at
// the next vertex.
#define DRAWN_EMITTER 0
#define DRAWN_ENVIRONMENT 2
#define DRAWN_ROULETTE 4

inline float2 drawn_pair(__global const float *drawn, uint stride, uint plane, uint i)
{
    return (float2)(drawn[plane * (size_t)stride + i], drawn[(plane + 1) * (size_t)stride + i]);
}

// VEC lanes from memory and back: element `first` and those that follow, `step` numbers apart, up to
// element `count - 1`; a load repeats the last for lanes beyond it.
inline vfloat lanes_from(__global const float *p, uint step, uint first, uint count)
{
    vfloat lanes;
    float *lane = (float *)&lanes;
    for (uint i = 0; i < VEC; ++i)
        lane[i] = p[(size_t)step * min(first + i, count - 1)];
    return lanes;
}

inline void lanes_to(__global float *p, uint step, uint first, uint count, vfloat lanes)
{
    const float *lane = (const float *)&lanes;
    for (uint i = 0; i < VEC; ++i)
        if (first + i < count)
            p[(size_t)step * (first + i)] = lane[i];
}

// Draws for every path what its start needs.
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void draw_starts(uint count, uint first, uint samples, uint round_seed, uint stride,
                 __global float *drawn)
{
    const uint i = get_global_id(0) * VEC;
    if (i >= count)
        return;
    vuint p;
    for (uint lane = 0; lane < VEC; ++lane)
        ((uint *)&p)[lane] = i + lane;
    const vuint seed = owner_seed(first + p / samples, round_seed), sample = p % samples;
    vfloat x, y;
    lanes_to(drawn + (size_t)stride * DRAWN_FRAGMENT, 1, i, count,
             sample_1d(sample, dimension_seed(seed, DIM_FRAGMENT)));
    sample_2d(sample, dimension_seed(seed, DIM_START), &x, &y);
    lanes_to(drawn + (size_t)stride * DRAWN_START, 1, i, count, x);
    lanes_to(drawn + (size_t)stride * (DRAWN_START + 1), 1, i, count, y);
}

// Where every vertex goes on, number `vertex` of its path: a direction distributed by the cosine to
// its shading normal (Malley's method), and the direction's density, negative below the geometric
// surface, where nothing arrives. Draws what connect and the next shade need, emitters and environment
// where there are any to `choose` (1 and 2).
__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1)))
void scatter(
    uint count, uint vertex, uint choose, uint first, uint samples, uint round_seed,
    __global const int *path, __global const float *shading, __global const float *geometric,
    __global float *direction, __global float *density, uint stride, __global float *drawn)
{
    const uint i = get_global_id(0) * VEC;
    if (i >= count)
        return;
    vuint p;
    for (uint lane = 0; lane < VEC; ++lane)
        ((uint *)&p)[lane] = path[min(i + lane, count - 1)];
    const vuint seed = owner_seed(first + p / samples, round_seed), sample = p % samples;
    vfloat x, y;
    for (uint light = 0; light < 2; ++light) {
        if (!(choose & (light + 1)))
            continue;
        const uint plane = light ? DRAWN_ENVIRONMENT : DRAWN_EMITTER;
        const uint dimension = light ? DIM_ENVIRONMENT(vertex) : DIM_EMITTER(vertex);
        sample_2d(sample, dimension_seed(seed, dimension), &x, &y);
        lanes_to(drawn + (size_t)stride * plane, 1, i, count, x);
        lanes_to(drawn + (size_t)stride * (plane + 1), 1, i, count, y);
    }
    if (vertex + 1 >= ROULETTE_AFTER)
        lanes_to(drawn + (size_t)stride * DRAWN_ROULETTE, 1, i, count,
                 sample_1d(sample, dimension_seed(seed, DIM_ROULETTE(vertex + 1))));

    sample_2d(sample, dimension_seed(seed, DIM_SCATTER(vertex)), &x, &y);
    vfloat across, up;
    vec_cos_sin_turns(y, &across, &up);
    const vfloat radius = sqrt(x), height = sqrt(1.0f - x);
    across *= radius;
    up *= radius;
    const vfloat nx = lanes_from(shading, 3, i, count);
    const vfloat ny = lanes_from(shading + 1, 3, i, count);
    const vfloat nz = lanes_from(shading + 2, 3, i, count);
    // Duff et al. 2017 as in common/vec.cl: across and up along the basis' two vectors.
    const vfloat s = copysign((vfloat)(1.0f), nz), a = -1.0f / (s + nz), c = nx * ny * a;
    vfloat dx = across * (1.0f + s * nx * nx * a) + up * c + height * nx;
    vfloat dy = across * s * c + up * (s + ny * ny * a) + height * ny;
    vfloat dz = height * nz - across * s * nx - up * ny;
    const vfloat scale = 1.0f / sqrt(dx * dx + dy * dy + dz * dz);
    dx *= scale;
    dy *= scale;
    dz *= scale;
    lanes_to(direction, 3, i, count, dx);
    lanes_to(direction + 1, 3, i, count, dy);
    lanes_to(direction + 2, 3, i, count, dz);
    const vfloat above = dx * lanes_from(geometric, 3, i, count) +
                         dy * lanes_from(geometric + 1, 3, i, count) +
                         dz * lanes_from(geometric + 2, 3, i, count);
    lanes_to(density, 1, i, count, above > 0.0f ? height * INV_PI_F : (vfloat)(-1.0f));
}

#endif
