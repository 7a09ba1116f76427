// A second tree, over what moves alone (gibench/techniques/parts/moving_tree.py): for rays whose way
// through all else is known. Its triangles have their numbers in the scene.
#ifndef GIBENCH_MOVERS
#define GIBENCH_MOVERS

#include "common/bvh.cl"

#define MOVER_PARAMS __global const float *mover_nodes, __global const float *mover_triangles
#define MOVER_BVH_ARGS BVH_ARGS_OF(mover_nodes, mover_triangles)

#endif
