"""A tree over what moves alone, refitted every frame: for rays that have met all else before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gibench.device import Argument, Buffer, BufferSpec, Device, Launch, integer, reads, updates
from gibench.rays.bvh import Bvh, build_bvh
from gibench.rays.bvh_wide import WIDTH
from gibench.rays.device_bvh import DeviceBvh
from gibench.rays.refit import RefitPlan
from gibench.scene.model import Scene
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.parts.moving_geometry import SOURCE
from gibench.techniques.parts.surfaces import Surfaces
from gibench.techniques.technique import GEOMETRY, Pass, Work

_NAME = "movers"
_ID = 9  # a block's row of triangle numbers


def tree_of_movers(scene: Scene, motion: MovingObjects) -> Bvh:
    """A tree over the triangles that move, as they lie at rest, by their numbers in the scene."""
    moving = np.flatnonzero(motion.triangles).astype(np.int32)
    tree = build_bvh(scene.corners[moving])
    blocks = tree.blocks.copy()
    ids = blocks.reshape(-1, _ID + 1, WIDTH)[:, _ID].view(np.int32)
    ids[ids >= 0] = moving[ids[ids >= 0]]
    return replace(tree, blocks=blocks)


@dataclass(frozen=True)
class MovingTree:
    """The tree on a device, and what is visited to refit it.

    Attributes:
        plan: what is visited.
        tree: that is refitted.
        surfaces: whose moved vertices it follows.
        triangle_slots: (m,) int32 of the plan.
        node_slots: (s,) int32 of the plan.
    """

    plan: RefitPlan = field(repr=False)
    tree: DeviceBvh
    surfaces: Surfaces
    triangle_slots: Buffer
    node_slots: Buffer

    @staticmethod
    def create(
        device: Device, scene: Scene, motion: MovingObjects, surfaces: Surfaces
    ) -> MovingTree:
        """The tree of what moves by ``motion``.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        bvh = tree_of_movers(scene, motion)
        tree = DeviceBvh.upload(device, bvh, _NAME)
        plan = RefitPlan.of(bvh, motion.triangles)
        held = device.allocate(
            _slots(plan),
            {"mover_triangle_slots": plan.triangle_slots, "mover_node_slots": plan.node_slots},
        )
        return MovingTree(
            plan, tree, surfaces, held["mover_triangle_slots"], held["mover_node_slots"]
        )

    @staticmethod
    def buffers(scene: Scene, motion: MovingObjects) -> list[BufferSpec]:
        """The buffers of the tree of what moves by ``motion``."""
        bvh = tree_of_movers(scene, motion)
        return [*DeviceBvh.buffers(bvh, _NAME), *_slots(RefitPlan.of(bvh, motion.triangles))]

    @property
    def args(self) -> tuple[Argument, ...]:
        """MOVER_PARAMS of kernels_cl/common/movers.cl."""
        return (
            reads("mover_nodes", self.tree.nodes),
            reads("mover_triangles", self.tree.triangles),
        )

    def passes(self) -> list[Pass]:
        """The pass that refits it, once the vertices are in their place."""
        refitted, visited = len(self.plan.triangle_slots), len(self.plan.node_slots)
        work = Work(
            bytes_read=refitted * 4 * (5 + 9)
            + visited * 4 * 2
            + 4 * (80 * self.plan.leaf_blocks + 48 * self.plan.inner),
            bytes_written=refitted * 4 * 9 + visited * 4 * 6,
        )
        return [Pass("refit_movers", self._launches, work, stage=GEOMETRY)]

    def _launches(self) -> Sequence[Launch]:
        count = len(self.plan.triangle_slots)
        leaves = (
            reads("slots", self.triangle_slots),
            integer("count", count),
            reads("triangles", self.surfaces.triangles),
            reads("positions", self.surfaces.positions),
            updates("blocks", self.tree.triangles),
        )
        return [
            Launch(SOURCE, "refit_leaves", leaves, items=count),
            *(
                Launch(
                    SOURCE,
                    "refit_nodes",
                    (
                        reads("slots", self.node_slots),
                        integer("first", first),
                        integer("count", level),
                        reads("bvh_triangles", self.tree.triangles),
                        updates("nodes", self.tree.nodes),
                    ),
                    items=level,
                )
                for first, level in self.plan.levels
            ),
        ]


def _slots(plan: RefitPlan) -> list[BufferSpec]:
    return [
        BufferSpec.of("mover_triangle_slots", len(plan.triangle_slots), np.int32),
        BufferSpec.of("mover_node_slots", len(plan.node_slots), np.int32),
    ]
