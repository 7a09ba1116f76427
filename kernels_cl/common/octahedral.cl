// The octahedral map of directions (Cigolle et al. 2014, "A Survey of Efficient Representations
// for Independent Unit Vectors"), z the folded axis; agrees with
// gibench/techniques/parts/octahedral_maps.py.
#ifndef GIBENCH_OCTAHEDRAL
#define GIBENCH_OCTAHEDRAL

// A direction (not necessarily unit length) to the square [-1, 1]^2.
inline float2 octahedral_encode(float3 d)
{
    const float scale = 1.0f / (fabs(d.x) + fabs(d.y) + fabs(d.z));
    const float2 p = d.xy * scale;
    if (d.z >= 0.0f)
        return p;
    return (float2)((1.0f - fabs(p.y)) * (p.x >= 0.0f ? 1.0f : -1.0f),
                    (1.0f - fabs(p.x)) * (p.y >= 0.0f ? 1.0f : -1.0f));
}

// The unit direction of a point of the square [-1, 1]^2.
inline float3 octahedral_decode(float2 p)
{
    const float z = 1.0f - fabs(p.x) - fabs(p.y);
    const float fold = fmax(-z, 0.0f);
    return normalize((float3)(p.x + (p.x >= 0.0f ? -fold : fold),
                              p.y + (p.y >= 0.0f ? -fold : fold), z));
}

// A number from -1 to 1 of 16 bits, the lower ones.
inline float snorm16(uint bits)
{
    return fmax((float)(short)(bits & 0xffffu) / 32767.0f, -1.0f);
}

// The unit direction of a point of the square in 32 bits: two numbers of 16, x lowest.
inline float3 octahedral_unpacked(uint bits)
{
    return octahedral_decode((float2)(snorm16(bits), snorm16(bits >> 16)));
}

// The cell of a direction in a grid x grid map: row * grid + column.
inline int octahedral_cell(float3 d, int grid)
{
    const float2 p = (octahedral_encode(d) * 0.5f + 0.5f) * grid;
    const int column = clamp((int)p.x, 0, grid - 1);
    const int row = clamp((int)p.y, 0, grid - 1);
    return row * grid + column;
}

#endif
