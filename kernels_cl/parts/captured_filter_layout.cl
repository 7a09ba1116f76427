// How radiance waits to be filtered: per probe that is relit three planes (red, green, blue) of STRIDE
// floats, of which the first TEXELS are the map's texels row by row and the others are 0.
#ifndef GIBENCH_CAPTURED_FILTER_LAYOUT
#define GIBENCH_CAPTURED_FILTER_LAYOUT

#define TEXELS (SIDE * SIDE)
#define STRIDE ((TEXELS + 15) / 16 * 16)

#endif
