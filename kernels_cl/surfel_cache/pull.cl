// The flux of every node of the hierarchy from its children's (Jendersie et al. 2016, section 4.1).
#include "surfel_cache/shared_exponent.cl"

// node_child  a node's first child, the other stands behind it; -1 of a leaf

inline void pull_node(__global const int *node_child, __global uint *node_flux, int node)
{
    const int child = node_child[node];
    if (child >= 0)
        node_flux[node] =
            shared_encode(shared_decode(node_flux[child]) + shared_decode(node_flux[child + 1]));
}

// pull: one work-item per node of one level, as published; levels from the deepest up.
__kernel void pull(__global const int *node_child, int first, int count, __global uint *node_flux)
{
    const int i = get_global_id(0);
    if (i < count)
        pull_node(node_child, node_flux, first + i);
}

// pull_subtrees: one work-item per subtree, whose inner nodes it visits children first: those of
// pull_order from pull_starts[first + i] up to the next start.
__kernel void pull_subtrees(__global const int *node_child, __global const int *pull_order,
                            __global const int *pull_starts, int first, int count,
                            __global uint *node_flux)
{
    const int i = get_global_id(0);
    if (i >= count)
        return;
    const int end = pull_starts[first + i + 1];
    for (int k = pull_starts[first + i]; k < end; ++k)
        pull_node(node_child, node_flux, pull_order[k]);
}
