// Dilation of a lightmap by one texel, so that a bilinear fetch at a chart's border meets no black.
// Bennett 2019, section 5.5: an invalid texel becomes the mean of its valid neighbours.
// In place and free of races: of valid texels (w = 1) everything is only read, of invalid ones x, y
// and z are only written and w, which stays 0, is only read.
// COMPONENTS: of the signal (common/lightmap.cl); those of a texel lie side by side.

inline void dilate_texel(__global float *map, int width, int height, int x, int y)
{
    float3 sum[COMPONENTS];
    for (int c = 0; c < COMPONENTS; ++c)
        sum[c] = (float3)(0.0f);
    float valid = 0.0f;
    for (int v = max(y - 1, 0); v <= min(y + 1, height - 1); ++v)
        for (int u = max(x - 1, 0); u <= min(x + 1, width - 1); ++u) {
            __global const float *texel = map + 4 * COMPONENTS * ((size_t)v * width + u);
            if (texel[3] > 0.0f) {
                for (int c = 0; c < COMPONENTS; ++c)
                    sum[c] += vload3(0, texel + 4 * c);
                valid += 1.0f;
            }
        }
    if (valid > 0.0f)
        for (int c = 0; c < COMPONENTS; ++c)
            vstore3(sum[c] / valid, 0, map + 4 * (COMPONENTS * ((size_t)y * width + x) + c));
}

// dilate: one work-item per texel of the lightmap, as published.
__kernel void dilate(__global float *map, int width, int height)
{
    const int i = get_global_id(0);
    if (i >= width * height || map[4 * COMPONENTS * (size_t)i + 3] > 0.0f)
        return;
    dilate_texel(map, width, height, i % width, i / width);
}

// dilate_border: one work-item per invalid texel beside a valid one, from a list made once.
__kernel void dilate_border(__global float *map, int width, int height,
                            __global const int *border, int count)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    dilate_texel(map, width, height, border[i] % width, border[i] / width);
}
