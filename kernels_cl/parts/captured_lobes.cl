// Radiance prefiltered for gloss: octahedral maps of every probe, one for each of LOBE_STEPS steps of
// roughness from a mirror to the roughest, each half as wide as the one before down to LEAST_LOBE_SIDE.
//
// Macros besides those of parts/octahedral_maps.cl and parts/probe_volume.cl: SIDE, LOBE_STEPS (2 or more),
// LEAST_LOBE_SIDE.
//
// lobe_maps  step by step, per probe (side + 2)^2 texels of 4: radiance, W/m2/sr; the fourth is not used
#ifndef GIBENCH_CAPTURED_LOBES
#define GIBENCH_CAPTURED_LOBES

#include "common/ggx.cl"
#include "parts/octahedral_maps.cl"
#include "parts/probe_volume.cl"

inline int lobe_side(int step)
{
    return max(SIDE >> step, min(SIDE, LEAST_LOBE_SIDE));
}

// The first texel of a step's maps.
inline size_t lobe_first(int step)
{
    size_t first = 0;
    for (int k = 0; k < step; ++k)
        first += (size_t)PROBES * MAP_TEXELS(lobe_side(k));
    return first;
}

inline float lobe_alpha(int step)
{
    return ggx_alpha((float)step / (LOBE_STEPS - 1));
}

#endif
