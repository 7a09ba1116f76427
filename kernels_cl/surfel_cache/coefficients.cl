// What a cache holds: COEFFICIENTS times 4 halves, red, green and blue; the fourth of the first is its mark:
// CACHE_LIT where there is a cache, CACHE_DILATED where its neighbours' mean stands, 0 where there is
// nothing. Macros: BANDS (2 to 4), CACHE_LIT, CACHE_DILATED.
#ifndef GIBENCH_SURFEL_COEFFICIENTS
#define GIBENCH_SURFEL_COEFFICIENTS

#define COEFFICIENTS (BANDS * BANDS)
#define SH_ORDER (BANDS - 1)

#endif
