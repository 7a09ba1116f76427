// How the rays' results are kept between shading and blending.
//
// Published (LANES 1): (PROBES, BLENDED) of radiance and distance, m, negative on a back.
// Tuned: planes, so that vectors of probes are read at once: for every LANES probes and every ray
// RAY_PLANES rows of LANES floats: radiance (0 on a back), 1 on a front and 0 on a back, the
// distance and its square as they are blended.
//
// Macros: RAY_PLANES; DISTANCE_EXPONENT, and WHOLE_EXPONENT, the same where it is a whole number and else 0.
#ifndef GIBENCH_DDGI_RAYS
#define GIBENCH_DDGI_RAYS

#define FAR_AWAY 1e27f

// A back counts as a fifth as far as it is: a probe near one should not be seen through it
// (RTXGI-DDGI 1.3.7). Clamped, in units of the longest distance that counts.
inline float blended_distance(float distance, float longest)
{
    return fmin(distance < 0.0f ? -0.2f * distance : distance, longest) / longest;
}

// A power of a cosine by repeated squaring where the exponent is a whole number.
inline float cosine_power(float cosine)
{
#if WHOLE_EXPONENT
    float square = cosine, power = 1.0f;
#pragma unroll
    for (int n = WHOLE_EXPONENT; n; n >>= 1) {
        if (n & 1)
            power *= square;
        square *= square;
    }
    return power;
#else
    return powr(cosine, DISTANCE_EXPONENT);
#endif
}

inline void store_ray(__global float *rays, int probe, int ray, float3 radiance, float distance,
                      float longest)
{
#if LANES == 1
    vstore4((float4)(radiance, distance), (size_t)probe * BLENDED + ray, rays);
#else
    const int block = probe / LANES, lane = probe % LANES;
    __global float *planes = rays + ((size_t)block * BLENDED + ray) * (RAY_PLANES * LANES) + lane;
    const float relative = blended_distance(distance, longest);
    planes[0] = radiance.x;
    planes[LANES] = radiance.y;
    planes[2 * LANES] = radiance.z;
    planes[3 * LANES] = distance < 0.0f ? 0.0f : 1.0f;
    planes[4 * LANES] = relative;
    planes[5 * LANES] = relative * relative;
#endif
}

#endif
