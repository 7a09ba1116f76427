// The caches' light from their links with vectors of VEC links: a cache's links lie side by side, one
// coefficient after the other. Macros: those of links.cl; VEC, which divides LINKS; UNROLL, vectors
// of links at a time, which divides LINKS / VEC.
#include "surfel_cache/links.cl"

#if VEC == 1
#define int_vector(i, p) ((p)[i])
#define uint_vector(i, p) ((p)[i])
#define half_vector(i, p) vload_half(i, (__global const half *)(p))
#define float_of_int(v) ((float)(v))
#define bits_as_float(v) as_float(v)
#define lanes_select(no, yes, condition) ((condition) ? (yes) : (no))
#else
#define int_vector(i, p) (((__global const vint *)(p))[i])
#define uint_vector(i, p) (((__global const vuint *)(p))[i])
#define float_of_int(v) VEC_JOIN(convert_float, VEC)(v)
#define bits_as_float(v) VEC_JOIN(as_float, VEC)(v)
#define lanes_select(no, yes, condition) ((condition) ? (yes) : (no))
// x86 converts a vector of halves in one instruction; vload_halfn is a function call in PoCL.
typedef VEC_JOIN(short, VEC) vshort;
#define short_vector(i, p) (((__global const vshort *)(p))[i])
#if VEC == 16 && defined(__AVX512F__) && defined(__clang__)
#define half_vector(i, p) \
    __builtin_ia32_vcvtph2ps512_mask(short_vector(i, p), (float16)(0.0f), (ushort)0xffff, 4)
#elif VEC == 8 && defined(__F16C__) && defined(__clang__)
#define half_vector(i, p) __builtin_ia32_vcvtph2ps256(short_vector(i, p))
#else
// Sign to bit 31, exponent and mantissa to where a float has them; subnormals are stored as 0.
#define half_vector(i, p) \
    (bits_as_float((VEC_JOIN(convert_int, VEC)(short_vector(i, p)) << 13) & (int)0x8fffe000) * 0x1p112f)
#endif
#endif

typedef struct {
    vfloat r, g, b;
} Light;

// The fluxes of VEC links' senders.
inline Light fluxes(__global const uint *node_flux, __global const int *nodes, size_t at)
{
    uint bits[VEC] __attribute__((aligned(64)));
    for (int lane = 0; lane < VEC; ++lane)
        bits[lane] = node_flux[nodes[at * VEC + lane]];
    const vuint packed = *(const vuint *)bits;
    const vfloat scale = bits_as_float(((packed >> 27) + 103u) << 23);
    Light light;
    light.r = float_of_int(packed & 511u) * scale;
    light.g = float_of_int(packed >> 9 & 511u) * scale;
    light.b = float_of_int(packed >> 18 & 511u) * scale;
    return light;
}

#if PROJECTION == PROJECTION_RUNTIME
inline vfloat snorms(vuint bits)
{
    // Sign-extended by shifting the low half up and down again.
#if VEC == 1
    const vint whole = as_int(bits << 16) >> 16;
#else
    const vint whole = VEC_JOIN(as_int, VEC)(bits << 16) >> 16;
#endif
    const vfloat v = float_of_int(whole) / 32767.0f;
    return lanes_select(v, (vfloat)(-1.0f), v < -1.0f);
}

// The basis of VEC links' caps, all bands weighed.
inline void caps(__global const uint *directions, __global const ushort *weights,
                 __global const ushort *solids, size_t at, vfloat *y)
{
    const vuint packed = uint_vector(at, directions);
    vfloat px = snorms(packed), py = snorms(packed >> 16);
    const vfloat pz = 1.0f - fabs(px) - fabs(py);
    const vfloat fold = lanes_select((vfloat)(0.0f), -pz, pz < 0.0f);
    px += lanes_select(fold, -fold, px >= 0.0f);
    py += lanes_select(fold, -fold, py >= 0.0f);
    const vfloat inverse = 1.0f / sqrt(px * px + py * py + pz * pz);
    for (int j = 0; j < COEFFICIENTS; ++j)
        y[j] = (vfloat)(0.0f);
    sh_accumulate(px * inverse, py * inverse, pz * inverse, half_vector(at, weights), y);
    const vfloat c = 1.0f - half_vector(at, solids) / TWO_PI_F;
    const vfloat one = 0.5f * (1.0f + c);
    for (int j = 1; j < 4; ++j)
        y[j] *= one;
#if BANDS > 2
    const vfloat two = one * c;
    for (int j = 4; j < 9; ++j)
        y[j] *= two;
#endif
#if BANDS > 3
    const vfloat three = one * (5.0f * c * c - 1.0f) * 0.25f;
    for (int j = 9; j < 16; ++j)
        y[j] *= three;
#endif
}
#endif

// cache_lighting: one work-item per cache, the first of them `first`.
// link_light: (caches, BANDS^2, LINKS) halves; link_weight: (caches, 2, LINKS) halves.
__kernel void cache_lighting(__global const uint *node_flux, LINK_PARAMS,
                             ENVIRONMENT_LIGHT_PARAM __global const int *cache_place, int first,
                             int count, float unscale, __global ushort *caches)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int cache = first + i;
    __global const int *nodes = link_node + (size_t)cache * LINKS;
    vfloat red[COEFFICIENTS], green[COEFFICIENTS], blue[COEFFICIENTS];
    for (int j = 0; j < COEFFICIENTS; ++j)
        red[j] = green[j] = blue[j] = (vfloat)(0.0f);
    for (int k = 0; k < LINKS / VEC; k += UNROLL) {
        Light light[UNROLL];
#pragma unroll
        for (int u = 0; u < UNROLL; ++u)
            light[u] = fluxes(node_flux, nodes, k + u);
#if PROJECTION == PROJECTION_STORED
        __global const ushort *lights = link_light + (size_t)cache * LINKS * COEFFICIENTS;
#pragma unroll
        for (int j = 0; j < COEFFICIENTS; ++j) {
            vfloat r = (vfloat)(0.0f), g = (vfloat)(0.0f), b = (vfloat)(0.0f);
#pragma unroll
            for (int u = 0; u < UNROLL; ++u) {
                const vfloat c = half_vector((size_t)j * (LINKS / VEC) + k + u, lights);
                r += c * light[u].r;
                g += c * light[u].g;
                b += c * light[u].b;
            }
            red[j] += r;
            green[j] += g;
            blue[j] += b;
        }
#else
        __global const ushort *weights =
            (__global const ushort *)link_weight + (size_t)cache * LINKS * 2;
#pragma unroll
        for (int u = 0; u < UNROLL; ++u) {
            vfloat y[COEFFICIENTS];
            caps(link_direction + (size_t)cache * LINKS, weights, weights + LINKS, k + u, y);
#pragma unroll
            for (int j = 0; j < COEFFICIENTS; ++j) {
                red[j] += y[j] * light[u].r;
                green[j] += y[j] * light[u].g;
                blue[j] += y[j] * light[u].b;
            }
        }
#endif
    }
    for (int j = 0; j < COEFFICIENTS; ++j) {
        const float3 sum = (float3)(vec_sum(red[j]), vec_sum(green[j]), vec_sum(blue[j]));
        STORE_CACHE(j, sum);
    }
}
