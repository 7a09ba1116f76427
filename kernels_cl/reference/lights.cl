// Light sampling for the reference path tracer: delta lights, emissive triangles, environment.
#ifndef GIBENCH_REFERENCE_LIGHTS
#define GIBENCH_REFERENCE_LIGHTS
#include "common/cutout.cl"
#include "reference/glow.cl"
#include "reference/sampler.cl"
#include "reference/surface.cl"

// A delta light is a record of LIGHT_FLOATS floats: position, direction it shines along, irradiance or
// intensity, kind (0 directional, 1 point, 2 spot), spot scale, spot offset.

// A connection from a surface point to a light: its direction, how far the light is (m), and what
// it would add to the integral of radiance times cosine over pi.
typedef struct {
    float3 direction;
    float distance;
    float3 weight;
} Connection;

// First index i of the ascending table (n) with table[i] > x; n - 1 when there is none. Without
// branches on the table, which no processor could predict.
inline int find_interval(__global const float *table, int n, float x)
{
    int low = 0;
    while (n > 1) {
        const int half_ = n / 2;
        low += table[low + half_ - 1] <= x ? half_ : 0;
        n -= half_;
    }
    return low;
}

// x rescaled to [0, 1) within interval i of the ascending table.
inline float within_interval(__global const float *table, int i, float x)
{
    const float low = i ? table[i - 1] : 0.0f;
    return clamp((x - low) / (table[i] - low), 0.0f, 0.99999994f);
}

// Power heuristic, beta = 2 (Veach 1997, "Robust Monte Carlo Methods", section 9.2.4).
inline float power_heuristic(float chosen, float other)
{
    const float a = chosen * chosen, b = other * other;
    return a > 0.0f ? a / (a + b) : 0.0f;
}

inline Connection connect_delta(__global const float *light, float3 point, float3 normal)
{
    Connection c;
    const float3 axis = load3(light, 1);
    const int kind = (int)light[9];
    c.weight = load3(light, 2) * INV_PI_F;
    if (kind == 0) {
        c.direction = -axis;
        c.distance = INFINITY;
    } else {
        const float3 to = load3(light, 0) - point;
        const float squared = dot(to, to);
        c.distance = sqrt(squared);
        c.direction = to / c.distance;
        c.weight /= squared;
        if (kind == 2) {
            // KHR_lights_punctual, "Inner and Outer Cone Angles".
            const float fade = clamp(-dot(c.direction, axis) * light[10] + light[11], 0.0f, 1.0f);
            c.weight *= fade * fade;
        }
    }
    c.weight *= max(dot(normal, c.direction), 0.0f);
    return c;
}

// A point on an emissive triangle, chosen by area and luminance; weighted against finding it by
// a cosine-distributed direction.
inline Connection connect_emitter(__global const float *triangles, __global const float *materials,
                                  __global const int *emitters, __global const float *table,
                                  int count, float2 random, float3 point,
                                  float3 normal CUTOUT_PARAM GLOW_PARAM PIECE_PARAM)
{
    const int i = find_interval(table, count, random.x);
    const float r = sqrt(within_interval(table, i, random.x));
#if GLOW
    const float2 at = in_piece(emitter_pieces, i, r * (1.0f - random.y), r * random.y);
    const float u = at.x, v = at.y;
#else
    const float u = r * (1.0f - random.y), v = r * random.y;
#endif
    const Surface s = surface_at(triangles, emitters[i], u, v);
    __global const float *material = materials + s.material * MATERIAL_FLOATS;
    const float3 to = leave_surface(s.point, s.geometric) - point;
    const float squared = dot(to, to);
    Connection c;
    c.distance = sqrt(squared);
    c.direction = to / c.distance;
    const float cosine = dot(normal, c.direction);
    const float facing = -dot(s.geometric, c.direction);
    float density = material[7];
    float3 emission = load3(material, 1);
#if GLOW
    glow_at(glow, emitters[i], u, v, &emission, &density);
#endif
    if (cosine > 0.0f && facing > 0.0f && squared > 0.0f && density > 0.0f) {
        const float by_light = density * squared / facing;
        const float by_cosine = cosine * INV_PI_F;
        c.weight = emission *
                   (by_cosine * power_heuristic(by_light, by_cosine) / by_light);
    } else {
        c.weight = (float3)(0.0f);
    }
#if CUTOUTS
    if (cut_away(cutouts, emitters[i], u, v))
        c.weight = (float3)(0.0f);
#endif
    return c;
}

// A direction chosen by the environment's radiance, uniform in solid angle within a pixel;
// weighted against finding it by a cosine-distributed direction. `edges` (height + 1) holds the
// cosines of the rows' polar angles.
inline Connection connect_environment(__global const float *pixels, __global const float *density,
                                      __global const float *rows, __global const float *columns,
                                      __global const float *edges,
                                      int width, int height, float2 random, float3 normal)
{
    const int row = find_interval(rows, height, random.x);
    __global const float *in_row = columns + (size_t)row * width;
    const int column = find_interval(in_row, width, random.y);
    const float y = mix(edges[row], edges[row + 1], within_interval(rows, row, random.x));
    const float x = column + within_interval(in_row, column, random.y);
    const float radius = sqrt(max(1.0f - y * y, 0.0f));
    // Azimuth -pi is column 0.
    float cosine, sine;
    cos_sin_turns(x / width, &cosine, &sine);
    Connection c;
    c.direction = (float3)(-radius * sine, y, radius * cosine);
    c.distance = INFINITY;
    c.weight = (float3)(0.0f);
    const float by_cosine = max(dot(normal, c.direction), 0.0f) * INV_PI_F;
    const float by_light = density[row * width + column];
    if (by_cosine > 0.0f && by_light > 0.0f) {
        const float down = acos(clamp(y, -1.0f, 1.0f)) * INV_PI_F * height;
        c.weight = environment_at(pixels, width, height, (float2)(x, down)) *
                   (by_cosine * power_heuristic(by_light, by_cosine) / by_light);
    }
    return c;
}

inline float environment_density(__global const float *density, int width, int height, float2 pixel)
{
    return density[clamp((int)pixel.y, 0, height - 1) * width + clamp((int)pixel.x, 0, width - 1)];
}

#endif
