"""Memory of a wave of paths (:mod:`gibench.reference.wavefront`), shared by host and kernels."""

from __future__ import annotations

import numpy as np

from gibench.device import reads, unsigned, writes
from gibench.reference.host_cl import HostProgram

DRAWN = 5
"""Numbers drawn ahead for a vertex or a start."""


class Vertices:
    """Surface points that paths have reached, and the rays that leave them."""

    def __init__(self, program: HostProgram, paths: int) -> None:
        self.origin = program.empty((paths, 3), np.float32)
        self.direction = program.empty((paths, 3), np.float32)
        self.shading = program.empty((paths, 3), np.float32)
        self.geometric = program.empty((paths, 3), np.float32)
        self.path = program.empty(paths, np.int32)
        self.density = program.empty(paths, np.float32)
        self.reached = (
            writes("origin", self.origin),
            writes("shading", self.shading),
            writes("geometric", self.geometric),
            writes("path", self.path),
        )


class Queues:
    """All that a wave of paths needs."""

    def __init__(self, program: HostProgram, paths: int, slots: int) -> None:
        self.paths = paths
        connections = max(1, paths * slots)
        self.vertices = (Vertices(program, paths), Vertices(program, paths))
        self.throughput = program.empty((paths, 3), np.float32)
        self.collected = program.empty((paths, 3), np.float32)
        self.mean = program.empty((paths, 3), np.float32)
        # Random numbers (kernels_cl/reference/draws.cl, DRAWN_...), planes of `paths` numbers.
        self.stride = unsigned("stride", paths)
        self.drawn = program.empty((DRAWN, paths), np.float32)
        self.drawn_before = (self.stride, reads("drawn", self.drawn))
        self.counter = program.empty(1, np.int32)
        self.ray_of = program.empty(connections, np.int32)
        self.weight = program.empty((connections, 3), np.float32)
        self.shadow_origin = program.empty((connections, 3), np.float32)
        self.shadow_direction = program.empty((connections, 3), np.float32)
        self.shadow_limit = program.empty(connections, np.float32)
        self.blocked = program.empty(connections, np.uint8)
