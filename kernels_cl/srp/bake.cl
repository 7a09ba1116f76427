// Transport coefficients of SRP (Bennett 2019, section 5.6: eqs 4.10-4.12 and 5.6;
// Silvennoinen and Lehtinen 2017, eqs 2 and 4) for a chunk of receivers: four kernels, between
// which the host traces rays; a fifth stands for the second where SRP's interpolation is compared
// with plain blending.
//
// Layout, with R receivers, S samples per receiver (a multiple of VEC; the ones past `samples` are
// padding) and receiver r's nearby probes at pairs pair_start[r] to pair_start[r + 1]:
//   rays        [R][S][3]   a direction of zero marks a sample that is invalid from the start
//   hits        [R][4][S]   x, y, z of the hit and 1, or the direction and 0 for an escape
//   visible     [pair][S]   uchar: 0 hidden, 1 visible, 2 undecided: the host traces a ray
//   inverse     [R][S]      1 / sum_k w_k V_k, or 0 where no probe sees the hit (invalid sample)
//   transport   [pair][COMPONENTS][SH_COUNT]
//   linear      [R][3][S]   what components 1 to 3 weigh a sample with
//   states      [rows][states_width] uchar, the same three values, a column per probe: one row per
//               receiver, then one per direction cell, then a row of HIDDEN and one of UNDECIDED
// Every kernel runs with work-groups of one work-item that does a block of samples: PoCL keeps the
// private arrays of a whole work-group on one thread's stack.
// Macros: BLOCK, samples of a work-item; HIDDEN, UNDECIDED, two of the three values; VEC, SH_ORDER,
// GRID (cells along one side of a probe's octahedral map, or 0: no tables, every pair is UNDECIDED);
// COMPONENTS of the light at a receiver (1; 4 for order 1, see gibench/techniques/srp/bake/data.py).
#include "common/vec.cl"
#include "common/vec_width.cl"
#include "common/sh.cl"
#include "common/octahedral.cl"

// One primary ray per sample (Bennett 2019, 5.6.2); a work-item is (block of samples, receiver).
// The direction is distributed about the receiver's normal by what weighs radiance in its irradiance
// there: the cosine; in order 1 what that makes of it, 1/4 + cosine / 2, by the inverse of its
// cumulative distribution (c + c^2) / 2. The origin is a point of the surface its texel covers, both
// from one 4D low-discrepancy point rotated per receiver (Cranley and Patterson 1976). The azimuth's
// rotation is done by the sums of angles, so that no trigonometry is left:
// points [S][8] holds u0, cos(2 pi u1), sin(2 pi u1), u2, u3 and padding, rotations [n][8] likewise.
// A direction that points below the very triangle it starts on leads into the solid: such a
// sample is invalid.
__kernel void transport_rays(const int stride, const int samples, const float offset,
                             __global const float *points, __global const float *rotations,
                             __global const int *receivers, __global const float *normals,
                             __global const int *fragment_start,
                             __global const float *fragment_share,
                             __global const float *fragment_corners,
                             __global const int *fragment_triangle,
                             __global const float4 *planes, __global float *origins,
                             __global float *directions)
{
    const int receiver = receivers[get_global_id(1)];
    const int begin = get_global_id(0) * BLOCK;
    const int end = min(begin + BLOCK, stride);
    __global const float *rotation = rotations + 8 * (size_t)receiver;
    const float rotate_cos = rotation[1], rotate_sin = rotation[2];
    const int first = fragment_start[receiver];
    const int last = fragment_start[receiver + 1] - 1;
    const float3 n = load3(normals, receiver);
    float3 t, b;
    orthonormal_basis(n, &t, &b);

    for (int s = begin; s < end; ++s) {
        __global const float *point = points + 8 * s;
        float u0 = point[0] + rotation[0];
        float u2 = point[3] + rotation[3];
        float u3 = point[4] + rotation[4];
        u0 -= u0 >= 1.0f ? 1.0f : 0.0f;
        u2 -= u2 >= 1.0f ? 1.0f : 0.0f;
        u3 -= u3 >= 1.0f ? 1.0f : 0.0f;

        int low = first;
        int high = last;
        while (low < high) {
            const int middle = (low + high) / 2;
            if (fragment_share[middle] > u2)
                high = middle;
            else
                low = middle + 1;
        }
        const float below = low > first ? fragment_share[low - 1] : 0.0f;
        const float width = fragment_share[low] - below;
        const float rest = width > 0.0f ? clamp((u2 - below) / width, 0.0f, 1.0f) : 0.5f;
        const float a = sqrt(rest);
        const float3 origin = load3(fragment_corners, 3 * (size_t)low) * (1.0f - a) +
                              load3(fragment_corners, 3 * (size_t)low + 1) * (a * (1.0f - u3)) +
                              load3(fragment_corners, 3 * (size_t)low + 2) * (a * u3);
        const float3 surface = planes[fragment_triangle[low]].xyz;

#if COMPONENTS > 1
        const float cosine = 0.5f * (sqrt(9.0f - 8.0f * u0) - 1.0f);
        const float radius = sqrt(max(1.0f - cosine * cosine, 0.0f));
#else
        const float cosine = sqrt(1.0f - u0);
        const float radius = sqrt(u0);
#endif
        const float x = radius * (point[1] * rotate_cos - point[2] * rotate_sin);
        const float y = radius * (point[2] * rotate_cos + point[1] * rotate_sin);
        float3 direction = t * x + b * y + n * cosine;
        if (s >= samples || dot(direction, surface) <= 0.0f)
            direction = (float3)(0.0f);
        const size_t ray = (size_t)get_global_id(1) * stride + s;
        store3(origins, ray, origin + offset * surface);
        store3(directions, ray, direction);
    }
}

// Validity of samples and their mutual visibility (Bennett 2019, 5.6.4); a work-item is (block of
// samples, receiver). What the tables settle is settled here; the rest is left UNDECIDED.
__kernel void transport_decide(
    const int stride, __global const float *origins, __global const float *directions,
    __global const int *hit_triangle, __global const float *hit_distance,
    __global const float *hit_u, __global const float *hit_v, __global const float4 *planes,
    __global const float *triangle_uvs, const int width, const int height,
    __global const int *receiver_of_texel, const int receivers, __global const uchar *states,
    const int states_width, __global const int *pair_start, __global const int *pair_probe,
    __global const float4 *probes, __global float *hits, __global uchar *visible)
{
    const int r = get_global_id(1);
    const int begin = get_global_id(0) * BLOCK;
    const int count = min(BLOCK, stride - begin);
    const size_t hidden_row = receivers + GRID * GRID;
    const size_t undecided_row = hidden_row + 1;
    float normal_x[BLOCK], normal_y[BLOCK], normal_z[BLOCK], distance[BLOCK];
    size_t row[BLOCK];

    for (int i = 0; i < count; ++i) {
        const size_t ray = (size_t)r * stride + begin + i;
        const float3 direction = load3(directions, ray);
        const int triangle = hit_triangle[ray];
        bool valid = dot(direction, direction) > 0.5f;
        // An escape has no surface: a plane that everything is in front of.
        float4 plane = (float4)(0.0f, 0.0f, 0.0f, -1.0f);
        float3 place = direction;
        size_t at = undecided_row;
        if (triangle >= 0) {
            plane = planes[triangle];
            place = load3(origins, ray) + hit_distance[ray] * direction;
            // Validity check 2: the surface faces the receiver.
            valid = valid && dot(plane.xyz, direction) < 0.0f;
#if GRID
            __global const float *uv = triangle_uvs + 6 * (size_t)triangle;
            const float w1 = hit_u[ray], w2 = hit_v[ray], w0 = 1.0f - w1 - w2;
            const float x = w0 * uv[0] + w1 * uv[2] + w2 * uv[4];
            const float y = w0 * uv[1] + w1 * uv[3] + w2 * uv[5];
            // False for the NaN of a triangle without a place in the atlas.
            if (x >= 0.0f && y >= 0.0f && x < width && y < height) {
                const int texel_receiver = receiver_of_texel[(int)y * width + (int)x];
                if (texel_receiver >= 0)
                    at = texel_receiver;
            }
        } else if (valid) {
            at = receivers + octahedral_cell(direction, GRID);
#endif
        }
        if (!valid) {
            place = (float3)(0.0f, 0.0f, 1.0f);
            at = hidden_row;
        }
        __global float *out = hits + (size_t)r * 4 * stride + begin + i;
        out[0] = place.x;
        out[stride] = place.y;
        out[2 * stride] = place.z;
        out[3 * stride] = valid && triangle >= 0 ? 1.0f : 0.0f;
        normal_x[i] = plane.x;
        normal_y[i] = plane.y;
        normal_z[i] = plane.z;
        distance[i] = plane.w;
        row[i] = at * states_width;
    }

    for (int pair = pair_start[r]; pair < pair_start[r + 1]; ++pair) {
        const int probe = pair_probe[pair];
        const float4 p = probes[probe];
        __global const uchar *state = states + probe;
        __global uchar *out = visible + (size_t)pair * stride + begin;
        for (int i = 0; i < count; ++i) {
            // Validity check 1: the probe is in front of the surface.
            const float side = normal_x[i] * p.x + normal_y[i] * p.y + normal_z[i] * p.z;
            out[i] = side > distance[i] ? state[row[i]] : (uchar)HIDDEN;
        }
    }
}

// What transport_decide writes, for plain blending (Bennett 2019, eq. 4.3; Silvennoinen and
// Lehtinen 2017, eq. 1): probes are looked up in the receiver's own direction, which is an escape's layout, and a
// pair counts for all samples or for none; a work-item is (block of samples, receiver).
__kernel void transport_plain(const int stride, __global const float *directions,
                                __global const int *pair_start, __global const uchar *pair_sees,
                                __global float *hits, __global uchar *visible)
{
    const int r = get_global_id(1);
    const int begin = get_global_id(0) * BLOCK;
    const int end = min(begin + BLOCK, stride);
    for (int s = begin; s < end; ++s) {
        const float3 direction = load3(directions, (size_t)r * stride + s);
        const bool valid = dot(direction, direction) > 0.5f;
        __global float *out = hits + (size_t)r * 4 * stride + s;
        out[0] = direction.x;
        out[stride] = direction.y;
        out[2 * stride] = valid ? direction.z : 1.0f;
        out[3 * stride] = 0.0f;
        for (int pair = pair_start[r]; pair < pair_start[r + 1]; ++pair)
            visible[(size_t)pair * stride + s] = valid ? pair_sees[pair] : (uchar)0;
    }
}

// The partition of unity's denominators, and how many samples are valid; one receiver per
// work-item, blocks of VEC samples.
__kernel void transport_weights(const int stride, __global const int *pair_start,
                                __global const float *pair_weight, __global const uchar *visible,
                                __global float *inverse, __global int *valid_samples)
{
    const int r = get_global_id(0);
    const int blocks = stride / VEC;
    vfloat valid = (vfloat)(0.0f);
    for (int block = 0; block < blocks; ++block) {
        vfloat sum = (vfloat)(0.0f);
        for (int pair = pair_start[r]; pair < pair_start[r + 1]; ++pair)
            sum += pair_weight[pair] * vec_load_uchar(block, visible + (size_t)pair * stride);
        const vfloat one = (vfloat)(1.0f);
        const vfloat zero = (vfloat)(0.0f);
        valid += select(zero, one, sum > zero);
        vec_store(select(zero, one / sum, sum > zero), block, inverse + (size_t)r * stride);
    }
    valid_samples[r] = (int)(vec_sum(valid) + 0.5f);
}

#if COMPONENTS > 1
// Irradiance's gradient in the normal, half of the integral of radiance times direction, by samples of
// the density (1/4 + cosine / 2) / pi: each counts direction / 2 over that, in units of the pi that
// alpha has in front; a work-item is (block of samples, receiver).
__kernel void transport_linear(const int stride, __global const int *receivers,
                               __global const float *normals, __global const float *directions,
                               __global float *linear)
{
    const int r = get_global_id(1);
    const int begin = get_global_id(0) * BLOCK;
    const int end = min(begin + BLOCK, stride);
    const float3 n = load3(normals, receivers[r]);
    for (int s = begin; s < end; ++s) {
        const float3 direction = load3(directions, (size_t)r * stride + s);
        const float3 weight = direction * (2.0f / (1.0f + 2.0f * max(dot(n, direction), 0.0f)));
        __global float *out = linear + (size_t)r * 3 * stride + s;
        out[0] = weight.x;
        out[stride] = weight.y;
        out[2 * stride] = weight.z;
    }
}
#define LINEAR_PARAM , __global const float *linear
#else
#define LINEAR_PARAM
#endif

// alpha = pi / M sum of K over the M valid samples (eq. 5.6); one (receiver, probe) pair and component
// per work-item, VEC samples at a time, all basis functions in private sums. The first component's
// samples count alike, those of the others by `linear`.
__kernel void transport_accumulate(const int stride, __global const int *pair_receiver,
                                   __global const int *pair_probe,
                                   __global const float *pair_weight,
                                   __global const float4 *probes, __global const float *hits,
                                   __global const uchar *visible, __global const float *inverse,
                                   __global const int *valid_samples LINEAR_PARAM,
                                   __global float *transport)
{
    const int pair = get_global_id(0);
    const int component = get_global_id(1);
    const int r = pair_receiver[pair];
    const float3 probe = probes[pair_probe[pair]].xyz;
    const float weight = pair_weight[pair];
    __global const float *hit = hits + (size_t)r * 4 * stride;
    const int blocks = stride / VEC;
    vfloat sums[SH_COUNT];
    for (int j = 0; j < SH_COUNT; ++j)
        sums[j] = (vfloat)(0.0f);
    for (int block = 0; block < blocks; ++block) {
        vfloat kernel_weight = weight * vec_load(block, inverse + (size_t)r * stride) *
                               vec_load_uchar(block, visible + (size_t)pair * stride);
        if (!vec_any(kernel_weight))
            continue;
#if COMPONENTS > 1
        if (component > 0)
            kernel_weight *= vec_load(block, linear + ((size_t)r * 3 + component - 1) * stride);
#endif
        const vfloat h = vec_load(block, hit + 3 * stride);
        const vfloat x = vec_load(block, hit) - h * probe.x;
        const vfloat y = vec_load(block, hit + stride) - h * probe.y;
        const vfloat z = vec_load(block, hit + 2 * stride) - h * probe.z;
        const vfloat scale = 1.0f / sqrt(x * x + y * y + z * z);
        sh_accumulate(x * scale, y * scale, z * scale, kernel_weight, sums);
    }
    const float mean = valid_samples[r] > 0 ? PI_F / valid_samples[r] : 0.0f;
    for (int j = 0; j < SH_COUNT; ++j)
        transport[((size_t)pair * COMPONENTS + component) * SH_COUNT + j] = mean * vec_sum(sums[j]);
}
