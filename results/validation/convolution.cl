// 2D convolution with the structure of Kernel Tuner's benchmark (van Werkhoven et al. 2014, "Optimizing
// convolution operations on GPUs using adaptive tiling"), to compare projections with times that others
// measured. Work-groups have one row: places in the block come from the local index.
// Macros: BLOCK_X, BLOCK_Y (work-items of a block), TILE_X, TILE_Y (outputs of a work-item), WIDTH
// (outputs of a row), FILTER_X, FILTER_Y, PADDED (rows of local memory are padded against bank
// conflicts), STAGED (the block's input is staged in local memory), CONSTANT (filter in constant
// memory).
#define ACROSS (BLOCK_X * TILE_X)
#define DOWN (BLOCK_Y * TILE_Y)
#define BLOCKS_ACROSS ((WIDTH + ACROSS - 1) / ACROSS)
// Rows are as long as whole blocks need, so that nothing has to be tested.
#define OUTPUT_WIDTH (BLOCKS_ACROSS * ACROSS)
#define INPUT_WIDTH (OUTPUT_WIDTH + FILTER_X - 1)
#define TILE_INPUT (ACROSS + FILTER_X - 1)
// Where a block is no multiple of the 32 banks, a row of local memory is made one.
#if PADDED && BLOCK_X % 32
#define PADDING (32 - (TILE_INPUT + BLOCK_X) % 32)
#else
#define PADDING 0
#endif
#define ROW (TILE_INPUT + PADDING)
#if CONSTANT
#define FILTER_SPACE __constant
#else
#define FILTER_SPACE __global const
#endif

// convolution: outputs TILE_X by TILE_Y a work-item, BLOCK_X and BLOCK_Y apart.
//   input   (height + FILTER_Y - 1, INPUT_WIDTH)   output  (height, OUTPUT_WIDTH)
//   filter  (FILTER_Y, FILTER_X)
__kernel void convolution(__global float *output, __global const float *restrict input,
                          FILTER_SPACE float *restrict filter)
{
    const int tx = get_local_id(0) % BLOCK_X, ty = get_local_id(0) / BLOCK_X;
    const int bx = get_group_id(0) % BLOCKS_ACROSS * ACROSS;
    const int by = get_group_id(0) / BLOCKS_ACROSS * DOWN;
#if STAGED
    __local float staged[(DOWN + FILTER_Y - 1) * ROW];
    for (int i = ty; i < DOWN + FILTER_Y - 1; i += BLOCK_Y)
        for (int j = tx; j < TILE_INPUT; j += BLOCK_X)
            staged[i * ROW + j] = input[(by + i) * INPUT_WIDTH + bx + j];
    barrier(CLK_LOCAL_MEM_FENCE);
#define AT(i, j) staged[(i) * ROW + (j)]
#else
#define AT(i, j) input[(by + (i)) * INPUT_WIDTH + bx + (j)]
#endif
    float sum[TILE_Y][TILE_X];
#pragma unroll
    for (int yi = 0; yi < TILE_Y; ++yi)
#pragma unroll
        for (int xi = 0; xi < TILE_X; ++xi)
            sum[yi][xi] = 0.0f;
#pragma unroll
    for (int i = 0; i < FILTER_Y; ++i)
#pragma unroll
        for (int j = 0; j < FILTER_X; ++j) {
            const float weight = filter[i * FILTER_X + j];
#pragma unroll
            for (int yi = 0; yi < TILE_Y; ++yi)
#pragma unroll
                for (int xi = 0; xi < TILE_X; ++xi)
                    sum[yi][xi] += AT(ty + yi * BLOCK_Y + i, tx + xi * BLOCK_X + j) * weight;
        }
#pragma unroll
    for (int yi = 0; yi < TILE_Y; ++yi)
#pragma unroll
        for (int xi = 0; xi < TILE_X; ++xi)
            output[(by + ty + yi * BLOCK_Y) * OUTPUT_WIDTH + bx + tx + xi * BLOCK_X] = sum[yi][xi];
}
