// The borders of octahedral maps (parts/octahedral_maps.cl).

// border_copy: one work-item per probe and border texel.
//   A map's border repeats the texels that lie on the other side of its edges in the octahedral
//   map, so that bilinear lookups need no special case: a side's texels mirrored about its middle,
//   a corner's from the opposite corner (Majercik et al. 2019, figure 3).
// maps: (probes, side + 2, side + 2) texels of `words` 32-bit words each, from texel `first` on.
__kernel void border_copy(__global uint *maps, int first, int probes, int side, int words)
{
    const int across = side + 2, border = 4 * (side + 1);
    const int i = get_global_id(0);
    if (i >= probes * border)
        return;
    const int k = i % border;
    int row, column;
    if (k < 2 * across) {
        row = k < across ? 0 : side + 1;
        column = k % across;
    } else {
        row = (k - 2 * across) / 2 + 1;
        column = k % 2 ? side + 1 : 0;
    }
    const bool beside = column == 0 || column == side + 1, above = row == 0 || row == side + 1;
    int from_row = beside ? side + 1 - row : row;
    int from_column = above ? side + 1 - column : column;
    from_row = clamp(from_row, 1, side);
    from_column = clamp(from_column, 1, side);
    __global uint *map = maps + (first + (size_t)(i / border) * across * across) * words;
    for (int w = 0; w < words; ++w)
        map[(row * across + column) * words + w] = map[(from_row * across + from_column) * words + w];
}
