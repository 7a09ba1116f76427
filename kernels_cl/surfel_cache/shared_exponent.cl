// Three channels in 32 bits: mantissas of 9 bits each, red lowest, and a shared exponent of 5 bits.
// The layout and rounding of OpenGL's EXT_texture_shared_exponent: from 2^-24 to SHARED_MOST, negative values
// and what is no number become 0, infinities the largest.
#ifndef GIBENCH_SHARED_EXPONENT
#define GIBENCH_SHARED_EXPONENT

inline uint shared_encode(float3 c)
{
    const float3 v = fmin(fmax(c, (float3)(0.0f)), (float3)(SHARED_MOST));
    const float largest = fmax(v.x, fmax(v.y, v.z));
    // The exponent by which the largest has 9 bits before the point: from floor(log2) on.
    const int log2_of = (int)(as_uint(largest) >> 23) - 127;
    int exponent = max(-16, log2_of) + 16;
    float scale = as_float((uint)(151 - exponent) << 23);
    if ((int)(largest * scale + 0.5f) > 511) {
        ++exponent;
        scale *= 0.5f;
    }
    return (uint)(v.x * scale + 0.5f) | (uint)(v.y * scale + 0.5f) << 9 |
           (uint)(v.z * scale + 0.5f) << 18 | (uint)exponent << 27;
}

inline float3 shared_decode(uint bits)
{
    const float scale = as_float(((bits >> 27) + 103u) << 23);
    return (float3)((float)(bits & 511u), (float)(bits >> 9 & 511u), (float)(bits >> 18 & 511u)) *
           scale;
}

#endif
