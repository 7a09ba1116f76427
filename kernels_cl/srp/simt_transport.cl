// Irradiance transport for devices that run work-items in lockstep: a work-group per tile of
// receivers, one each, neighbours on neighbouring values.
// Macros: STORAGE, TILE (receivers of one cluster side by side: the work-group's size); COMPONENTS of
// the light at a receiver.
#define VEC 1
#include "common/vec.cl"
#include "srp/storage.cl"

#ifndef COMPONENTS
#define COMPONENTS 1
#endif

// A tile's row of `tiles`, TILE_INTS ints.
#define TILE_INTS 3
#define FIRST_VALUE 0 // in units of TILE values
#define FIRST_ROW 1   // of the light basis vectors
#define ROWS 2        // light basis vectors

// irradiance_transport: one work-item per receiver, one work-group per tile.
//   component[receiver] = sum over light basis vectors of
//                         reconstruction[j, component][receiver] * basis[j]
// The reconstruction matrix is transposed within tiles: TILE receivers side by side, component after
// component and one light basis vector after the other. The tile is the group's, so that all its
// work-items loop alike.
//   texel     (tiles * TILE,) of the receivers; -1 where a cluster's last tile is not full
//   indirect  lightmap of the signal (common/lightmap.cl), W/m2
__kernel void irradiance_transport(__global const int *tiles,
                                   __global const stored_t *reconstruction,
                                   __global const int *texel, __global const float *basis,
                                   __global float4 *indirect)
{
    const int lane = get_local_id(0);
    __global const int *tile = tiles + TILE_INTS * get_group_id(0);
    __global const stored_t *value = reconstruction + (size_t)tile[FIRST_VALUE] * TILE + lane;
    __global const float *light = basis + 3 * (size_t)tile[FIRST_ROW];
    const int rows = tile[ROWS];
    float red[COMPONENTS], green[COMPONENTS], blue[COMPONENTS];
#pragma unroll
    for (int c = 0; c < COMPONENTS; ++c)
        red[c] = green[c] = blue[c] = 0.0f;
    for (int j = 0; j < rows; ++j) {
#pragma unroll
        for (int c = 0; c < COMPONENTS; ++c) {
            const float m = stored_value(value + (COMPONENTS * j + c) * TILE);
            red[c] += m * light[3 * j];
            green[c] += m * light[3 * j + 1];
            blue[c] += m * light[3 * j + 2];
        }
    }
    const int at = texel[get_group_id(0) * TILE + lane];
    if (at < 0)
        return;
#pragma unroll
    for (int c = 0; c < COMPONENTS; ++c)
        indirect[(size_t)COMPONENTS * at + c] = (float4)(red[c], green[c], blue[c], 1.0f);
}
