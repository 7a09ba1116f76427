// What a link sends where its light is projected at run time: a cap of the sender's solid angle about
// its direction. Macros: those of surfel_cache/links.cl.
#ifndef GIBENCH_SURFEL_CAPS
#define GIBENCH_SURFEL_CAPS

#include "common/octahedral.cl"
#include "surfel_cache/links.cl"

// The basis of a cap, the factor of each band over the first's in it. packed: octahedral direction, two
// snorm16; weight: the first coefficient over y_0; solid: angle, sr. y: COEFFICIENTS.
inline void cap_basis(uint packed, float weight, float solid, float *y)
{
    const float3 d = octahedral_unpacked(packed);
    const float c = 1.0f - solid / TWO_PI_F;
    const float one = 0.5f * (1.0f + c);
    const float bands[4] = {1.0f, one, one * c, one * (5.0f * c * c - 1.0f) * 0.25f};
    for (int j = 0; j < COEFFICIENTS; ++j)
        y[j] = 0.0f;
    sh_accumulate(d.x, d.y, d.z, weight, y);
    for (int l = 0; l < BANDS; ++l)
        for (int j = l * l; j < (l + 1) * (l + 1); ++j)
            y[j] *= bands[l];
}

#endif
