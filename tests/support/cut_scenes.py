"""Leaves with masks, and the same leaves with the holes cut in their mesh."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gibench.scene.cutouts import Cutouts
from gibench.scene.environment import Environment
from gibench.scene.model import Camera, Material, PointLight, Scene
from support.reference_scenes import box, quad, scene_of

WALL, LEAF = 0, 1
MATERIALS = (Material("wall", (0.7, 0.6, 0.5)), Material("leaf", (0.3, 0.8, 0.2)))
LAMP = PointLight((0.25, 0.75, 0.25), (1.0, 0.9, 0.8))
CAMERA = Camera((0.5, 0.5, 0.05), (0.5, 0.4, 1.0), 70.0)


class Leaves(NamedTuple):
    """One scene twice.

    masked: with cut-outs; meshed: without, with holes. leaf_of: of the triangles of each, the side
    of a leaf, -1 for walls.
    """

    masked: Scene
    meshed: Scene
    leaf_of: tuple[np.ndarray, np.ndarray]


def leaves(
    rng, count=6, image=(5, 4), repeat=1, lights=(LAMP,), glow=(0.0, 0.0, 0.0), sky=0.0
) -> Leaves:
    """A room with leaves, quads whose two sides each have a mask of holes."""
    walls = box()
    masked, meshed = [*walls], [*walls]
    uvs, fine = [np.zeros((3, 2))] * len(walls), [np.zeros((3, 2))] * len(walls)
    of, of_fine = [-1] * len(walls), [-1] * len(walls)
    images, which = [], []
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    for leaf in range(count):
        mask = rng.random(image) < 0.5
        images.append(mask)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.25, 0.5)
        corner = rng.uniform(0.35, 0.65, 3) - (turn[0] + turn[1]) / 2
        for side in (1, -1):
            # Sides lie a little apart, as loading places the backs of two-sided surfaces.
            off = corner + side * 2e-5 * turn[2] / np.linalg.norm(turn[2])
            order = [0, 1, 2, 3] if side > 0 else [3, 2, 1, 0]
            for corners, texels, owner, cut in (
                (masked, uvs, of, [(0.0, 0.0, 1.0, 1.0)]),
                (meshed, fine, of_fine, _there(mask, repeat)),
            ):
                for x0, y0, x1, y1 in cut:
                    at = square * (x1 - x0, y1 - y0) + (x0, y0)
                    points = off + at[:, :1] * turn[0] + at[:, 1:] * turn[1]
                    for triangle in ((0, 1, 2), (0, 2, 3)):
                        chosen = [order[i] for i in triangle]
                        corners.append(points[chosen])
                        texels.append(at[chosen] * repeat)
                        owner.append(2 * leaf + (side < 0))
            which += [leaf, leaf]
    made = []
    for corners, texels, owner in ((masked, uvs, of), (meshed, fine, of_fine)):
        ids = np.where(np.array(owner) < 0, WALL, LEAF)
        leaf = replace(MATERIALS[LEAF], emission=glow)
        made.append(
            scene_of(
                np.array(corners),
                ids,
                (MATERIALS[WALL], leaf),
                lights=lights,
                uvs=np.array(texels).reshape(-1, 2),
                environment=Environment.constant((sky, sky, sky)),
            )
        )
    holed = np.flatnonzero(np.array(of) >= 0).astype(np.int32)
    cutouts = Cutouts(
        tuple(images), holed, np.array(which, np.int32), np.array(uvs, np.float32)[holed]
    )
    return Leaves(
        replace(made[0], cutouts=cutouts, cameras=(CAMERA,)),
        replace(made[1], cameras=(CAMERA,)),
        (np.array(of), np.array(of_fine)),
    )


def _there(mask, repeat):
    """Squares (x0, y0, x1, y1) of a quad where a mask has surface, y upwards."""
    rows, columns = np.nonzero(np.tile(mask, (repeat, repeat)))
    height, width = mask.shape[0] * repeat, mask.shape[1] * repeat
    for row, column in zip(rows, columns, strict=True):
        yield column / width, 1 - (row + 1) / height, (column + 1) / width, 1 - row / height


def cut_at_random(scene: Scene, rng) -> Scene:
    """The scene with holes in every other triangle."""
    triangle = np.arange(0, len(scene.triangles), 2, dtype=np.int32)
    images = tuple(rng.random(shape) < 0.6 for shape in ((3, 5), (7, 9)))
    return replace(
        scene,
        cutouts=Cutouts(
            images,
            triangle,
            rng.integers(0, 2, len(triangle)).astype(np.int32),
            rng.uniform(-2, 2, (len(triangle), 3, 2)).astype(np.float32),
        ),
    )


def floor_of(scene: Scene):
    """The triangles of the room's floor, in pairs of one."""
    low = scene.corners[:, :, 1].max(axis=1) < 1e-6
    return np.flatnonzero(low)


def layers(count, mask, gap):
    """Quads one behind the other, each with the same mask, before a whole one."""
    corners = [t for i in range(count + 1) for t in quad((0, 0, gap * i), (1, 0, 0), (0, 1, 0))]
    uvs = np.array([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]] * count, np.float32)
    cutouts = Cutouts(
        (mask,), np.arange(2 * count, dtype=np.int32), np.zeros(2 * count, np.int32), uvs
    )
    return np.array(corners, np.float32), cutouts
