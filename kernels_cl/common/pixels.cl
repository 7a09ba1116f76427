// The order in which pixels are visited.
// Macros: TILE_SIDE (8), of gibench.techniques.parts.macros.
#ifndef GIBENCH_PIXELS
#define GIBENCH_PIXELS

// Pixels are visited in tiles of 8 x 8, within a tile along a Morton curve, so that the rays of
// neighbouring work-items run together.
#define TILE_PIXELS (TILE_SIDE * TILE_SIDE)

inline int even_bits(int code)
{
    return (code & 1) | ((code >> 1) & 2) | ((code >> 2) & 4);
}

// Where a tile's pixel number `code` lies in it. Of pixels that follow on each other from a multiple of
// a power of two on, up to that many, it tells where they lie from the first.
inline int2 tile_offset(int code)
{
    return (int2)(even_bits(code), even_bits(code >> 1));
}

// The pixel of work-item `item`; may lie outside the image at its right and lower border.
inline int2 tiled_pixel(int item, int width)
{
    const int tiles_across = (width + TILE_SIDE - 1) / TILE_SIDE;
    const int tile = item / TILE_PIXELS;
    return (int2)(tile % tiles_across, tile / tiles_across) * TILE_SIDE +
           tile_offset(item % TILE_PIXELS);
}

// A pixel's place in an image kept row by row.
inline int row_place(int2 pixel, int width)
{
    return pixel.y * width + pixel.x;
}

#endif
