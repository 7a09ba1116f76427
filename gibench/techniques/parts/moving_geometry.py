"""What of a scene moves, on a device: moved to its place and refitted before anything is traced."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Floats
from gibench.device import (
    Buffer,
    BufferSpec,
    Device,
    Launch,
    ProgramSpec,
    integer,
    reads,
    updates,
)
from gibench.rays.bvh import BVH_MACROS, Bvh
from gibench.rays.device_bvh import DeviceBvh
from gibench.rays.refit import RefitPlan
from gibench.scene.model import Scene
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.technique import GEOMETRY, Pass, Work

TRANSFORM_FLOATS = 12
"""3 x 4, row-major."""

SOURCE = ProgramSpec("rays/refit.cl", BVH_MACROS)
_POINT_FLOPS, _DIRECTION_FLOPS = 18, 15


def transform_table(transforms: npt.NDArray[np.floating[Any]]) -> Floats:
    """Transforms (objects, 3, 4) as kernels read them, (objects, 12) float32."""
    return np.ascontiguousarray(transforms, np.float32).reshape(-1, TRANSFORM_FLOATS)


@dataclass(frozen=True)
class MovingGeometry:
    """The moving vertices in object space, and what of the tree follows them.

    Attributes:
        device: where it lies.
        plan: what of the tree is visited.
        tree: that is refitted.
        transforms: (objects, 12) float32 object to world.
        positions: (v, 3) float32 of all vertices in the world, m.
        normals: (v, 3) float32 of all vertices in the world.
        triangles: (t, 3) int32.
        vertices: (n,) int32 those that move.
        vertex_objects: (n,) int32 the object of each.
        rest_positions: (n, 3) float32 in object space, m.
        rest_normals: (n, 3) float32 in object space.
        triangle_slots: (m,) int32 of the plan.
        node_slots: (s,) int32 of the plan.
    """

    device: Device
    plan: RefitPlan = field(repr=False)
    tree: DeviceBvh
    transforms: Buffer
    positions: Buffer
    normals: Buffer
    triangles: Buffer
    vertices: Buffer
    vertex_objects: Buffer
    rest_positions: Buffer
    rest_normals: Buffer
    triangle_slots: Buffer
    node_slots: Buffer

    @staticmethod
    def create(
        device: Device,
        scene: Scene,
        motion: MovingObjects,
        tree: DeviceBvh,
        transforms: Buffer,
        positions: Buffer,
        normals: Buffer,
        triangles: Buffer,
    ) -> MovingGeometry:
        """What of ``scene`` moves by ``motion``; the other arguments are on the device already.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        vertices, objects = motion.vertices(scene)
        plan = RefitPlan.of(tree.bvh, motion.triangles)
        specs = MovingGeometry.buffers_of(
            len(vertices), len(plan.triangle_slots), len(plan.node_slots)
        )
        data = {
            "moving_vertices": vertices,
            "moving_vertex_objects": objects,
            "rest_positions": scene.positions[vertices],
            "rest_normals": scene.normals[vertices],
            "moving_triangle_slots": plan.triangle_slots,
            "moving_node_slots": plan.node_slots,
        }
        held = device.allocate(specs, data)
        return MovingGeometry(
            device=device,
            plan=plan,
            tree=tree,
            transforms=transforms,
            positions=positions,
            normals=normals,
            triangles=triangles,
            vertices=held["moving_vertices"],
            vertex_objects=held["moving_vertex_objects"],
            rest_positions=held["rest_positions"],
            rest_normals=held["rest_normals"],
            triangle_slots=held["moving_triangle_slots"],
            node_slots=held["moving_node_slots"],
        )

    @staticmethod
    def buffers(scene: Scene, motion: MovingObjects, bvh: Bvh | None) -> list[BufferSpec]:
        """Its own buffers; without the tree a lower bound, of which no node is known to move."""
        vertices = len(motion.vertices(scene)[0])
        triangles = int(np.count_nonzero(motion.triangles))
        nodes = 0 if bvh is None else len(RefitPlan.of(bvh, motion.triangles).node_slots)
        return MovingGeometry.buffers_of(vertices, triangles, nodes)

    @staticmethod
    def buffers_of(vertices: int, triangles: int, nodes: int) -> list[BufferSpec]:
        """Its own buffers for so many that move."""
        of = BufferSpec.of
        return [
            of("moving_vertices", vertices, np.int32),
            of("moving_vertex_objects", vertices, np.int32),
            of("rest_positions", (vertices, 3), np.float32),
            of("rest_normals", (vertices, 3), np.float32),
            of("moving_triangle_slots", triangles, np.int32),
            of("moving_node_slots", nodes, np.int32),
        ]

    def move(self, transforms: npt.NDArray[np.floating[Any]]) -> None:
        """Say where the objects are in the coming frame: transforms (objects, 3, 4)."""
        self.device.write(self.transforms, transform_table(transforms))

    def passes(self) -> list[Pass]:
        """The passes that put everything in its place, in order. They only compare while refitting,
        which counts no flops.
        """
        moved, refitted = self.vertices.shape[0], self.triangle_slots.shape[0]
        visited = self.node_slots.shape[0]
        return [
            Pass(
                "move_vertices",
                self._move_vertices,
                Work(
                    flops=moved * (_POINT_FLOPS + _DIRECTION_FLOPS),
                    bytes_read=moved * 4 * 8 + self.transforms.nbytes,
                    bytes_written=moved * 4 * 6,
                ),
                stage=GEOMETRY,
            ),
            Pass(
                "refit_leaves",
                self._refit_leaves,
                # Its slot, its number, its corners' numbers; every vertex once.
                Work(
                    bytes_read=refitted * 4 * 5 + moved * 4 * 3,
                    bytes_written=refitted * 4 * 9,
                ),
                stage=GEOMETRY,
            ),
            Pass(
                "refit_nodes",
                self._refit_nodes,
                # Its slot and its child; a leaf's blocks, or the bounds of a node's children.
                Work(
                    bytes_read=visited * 4 * 2
                    + 4 * (80 * self.plan.leaf_blocks + 48 * self.plan.inner),
                    bytes_written=visited * 4 * 6,
                ),
                stage=GEOMETRY,
            ),
        ]

    def _move_vertices(self) -> Sequence[Launch]:
        count = self.vertices.shape[0]
        args = (
            reads("transforms", self.transforms),
            reads("vertices", self.vertices),
            reads("vertex_objects", self.vertex_objects),
            reads("rest_positions", self.rest_positions),
            reads("rest_normals", self.rest_normals),
            integer("count", count),
            updates("positions", self.positions),
            updates("normals", self.normals),
        )
        return [Launch(SOURCE, "move_vertices", args, items=count)]

    def _refit_leaves(self) -> Sequence[Launch]:
        count = self.triangle_slots.shape[0]
        args = (
            reads("slots", self.triangle_slots),
            integer("count", count),
            reads("triangles", self.triangles),
            reads("positions", self.positions),
            updates("blocks", self.tree.triangles),
        )
        return [Launch(SOURCE, "refit_leaves", args, items=count)]

    def _refit_nodes(self) -> Sequence[Launch]:
        return [
            Launch(
                SOURCE,
                "refit_nodes",
                (
                    reads("slots", self.node_slots),
                    integer("first", first),
                    integer("count", count),
                    reads("bvh_triangles", self.tree.triangles),
                    updates("nodes", self.tree.nodes),
                ),
                items=count,
            )
            for first, count in self.plan.levels
        ]
