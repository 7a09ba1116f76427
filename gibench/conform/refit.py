"""Moving geometry: vertices against float64, and the refitted tree's boxes against the triangles
beneath them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gibench.arrays import Array
from gibench.rays.bvh import Bvh
from gibench.rays.bvh_wide import WIDTH
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.scene.poses import Turn
from gibench.techniques.parts.conformance.case import Bench, Case, off, run
from gibench.techniques.parts.conformance.synthetic import random_scene
from gibench.techniques.parts.frame_scene import FrameScene

ROUNDING = float(np.finfo(np.float32).eps) / 2


def bounds_beneath(bvh: Bvh) -> Array:
    """Every child's bounds (w, 6, WIDTH) from the triangles beneath it, by visiting them all."""
    blocks = bvh.blocks.reshape(-1, 10, WIDTH)
    there = blocks[:, 9].view(np.int32) >= 0
    corners = blocks[:, :9].reshape(-1, 3, 3, WIDTH)
    missing = ~there[:, None, None]
    low = np.where(missing, np.inf, corners).min(axis=(1, 3))
    high = np.where(missing, -np.inf, corners).max(axis=(1, 3))
    nodes = bvh.nodes.reshape(-1, 7, WIDTH)
    child = nodes[:, 6].view(np.int32)
    found = np.zeros((len(nodes), WIDTH, 6), np.float32)
    found[..., 0::2], found[..., 1::2] = np.inf, -np.inf
    for node in reversed(range(len(nodes))):  # breadth first: children come after their parents
        for slot in np.flatnonzero(nodes[node, 0] < np.inf):
            number = child[node, slot]
            if number < 0:
                part = slice(~number >> 2, (~number >> 2) + (~number & 3) + 1)
                found[node, slot, 0::2] = low[part].min(axis=0)
                found[node, slot, 1::2] = high[part].max(axis=0)
            else:
                found[node, slot, 0::2] = found[number, :, 0::2].min(axis=0)
                found[node, slot, 1::2] = found[number, :, 1::2].max(axis=0)
    return found.transpose(0, 2, 1)


def vertex_bound(positions: Array, transforms: Array) -> Array:
    """What float32 may be off by at vertices (n, 3) m of transforms (n, 3, 4): the rounding of four
    products and sums, and of the transform itself.
    """
    m = np.abs(transforms)
    bound = np.einsum("nij,nj->ni", m[:, :, :3], np.abs(positions.astype(np.float64))) + m[..., 3]
    return np.asarray(6 * ROUNDING * bound)


def _moved(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Objects on the move: their vertices, the leaves' corners, all boxes above them."""
    scene = random_scene(rng, 150)
    objects = rng.integers(0, 3, 150).astype(np.int32)
    scene = replace(scene, object_ids=objects, object_names=("still", "one", "other"))
    turns = [
        Turn(name, tuple(rng.normal(size=3).tolist()), period_frames=int(rng.integers(7, 30)))
        for name in ("one", "other")
    ]
    motion = MovingObjects.of(scene, turns)
    device = bench.open()
    shared = FrameScene(device, scene, 8, 8, scene.cameras[0], motion=motion)
    vertices, owner = motion.vertices(scene)
    rest = np.setdiff1d(np.arange(len(scene.positions)), vertices)
    for frame in (3, 1):
        shared.begin_frame(frame)
        for item in shared.passes():
            run(device, item.launches(), size)
        m = motion.transforms_in(frame)[owner]
        at = scene.positions[vertices].astype(np.float64)
        normal = scene.normals[vertices].astype(np.float64)
        found = device.read(shared.surfaces.positions)
        expected = np.einsum("nij,nj->ni", m[:, :, :3], at) + m[:, :, 3]
        yield off(np.abs(found[vertices] - expected) / vertex_bound(at, m), np.zeros_like(at), 0, 1)
        turned = device.read(shared.surfaces.normals)
        expected = np.einsum("nij,nj->ni", m[:, :, :3], normal)
        yield off(turned[vertices], expected, absolute=6 * ROUNDING * 3**0.5)
        yield off(found[rest], scene.positions[rest])
        nodes, blocks = (device.read(a.value) for a in shared.bvh_args)  # type: ignore[arg-type]
        tree = replace(shared.bvh, nodes=nodes, blocks=blocks)
        inner = tree.nodes.reshape(-1, 7, WIDTH)
        yield off(inner[:, :6], bounds_beneath(tree))
        leaves = tree.blocks.reshape(-1, 10, WIDTH)
        block, slot = np.nonzero(leaves[:, 9].view(np.int32) >= 0)
        triangle = leaves[block, 9, slot].view(np.int32)
        corners = found[scene.triangles[triangle]].reshape(-1, 9)
        yield off(leaves[block, :9, slot], corners)


CASES = [
    Case(
        "Objects on the move",
        tuple(f"rays/refit.cl:{name}" for name in ("move_vertices", "refit_leaves", "refit_nodes")),
        _moved,
    )
]
