"""The surfels' buffers: preallocated, structure of arrays, with a stack of free IDs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gibench.device import Buffer, BufferSpec, Device
from gibench.techniques.gibs.macros import (
    COUNT_FREE,
    COUNT_WORDS,
    ESTIMATOR_ROWS,
    FRAME_WORDS,
    GUIDE_FLOATS,
    MOMENT_FLOATS,
    NO_RAY,
)
from gibench.techniques.gibs.settings import GibsSettings
from gibench.techniques.parts.scan import BlockScan
from gibench.techniques.parts.surfels import SurfelGeometry

SCAN = "surfel_scan"
"""The scratch of their prefix sum begins with this in the ledger."""


def most_rays(settings: GibsSettings) -> int:
    """Rays of a frame with all surfels alive."""
    return min(settings.ray_budget, math.ceil(settings.rays_per_surfel * settings.surfels))


def rays_in_frame(settings: GibsSettings, alive: int) -> int:
    """Rays of a frame with ``alive`` surfels: one each on average, within the budget."""
    return min(settings.ray_budget, math.ceil(settings.rays_per_surfel * alive))


@dataclass(frozen=True)
class Surfels:
    """All that is kept of surfels, and of the rays of a frame.

    Attributes:
        geometry: what sorting works on.
        estimator: (12, n) float32 multi-scale mean estimators (kernels_cl/gibs/estimator.cl);
            ``geometry.mean`` is the same buffer.
        births: (n,) uint32 a number for each surfel's random choices.
        seen: (n,) uint32 the frame each was last seen in.
        moments: (n, 48) float32 depth moments; one surfel's when they are off.
        guides: (n, 16) float32 ray guides; one surfel's when they are off.
        free_ids: (n,) uint32 the stack of free IDs.
        counters: (5,) uint32 (kernels_cl/gibs/frame.cl).
        marks: (n,) uint32 scratch: requested rays, then who survives.
        before: (n + 1,) uint32 scratch: the exclusive prefix sum of ``marks``.
        survivors: (n,) uint32 scratch.
        scan: scratch of that prefix sum.
        ray_first: (n + 1,) uint32 first ray of each surfel.
        ray_owner: (rays,) uint32.
        ray_light: (rays, 4) float32 radiance and distance.
        ray_choice: (rays, 2) float32 weight and texel.
        ray_hit: (rays, 4) float32 triangle and barycentrics of rays that hit bare surface; None
            where only the camera places.
        cell_ray: (cells,) uint32 which of them is taken in each cell; None likewise.
    """

    geometry: SurfelGeometry
    estimator: Buffer
    births: Buffer
    seen: Buffer
    moments: Buffer
    guides: Buffer
    free_ids: Buffer
    counters: Buffer
    marks: Buffer
    before: Buffer
    survivors: Buffer
    scan: BlockScan
    ray_first: Buffer
    ray_owner: Buffer
    ray_light: Buffer
    ray_choice: Buffer
    ray_hit: Buffer | None
    cell_ray: Buffer | None

    @staticmethod
    def create(
        device: Device,
        settings: GibsSettings,
        transforms: Buffer,
        workgroup_size: int,
        bare_cells: int = 0,
    ) -> Surfels:
        """Room for ``settings.surfels`` surfels, none placed, that go with their objects, whose
        ``transforms`` (objects, 12) to the world are not its own. ``bare_cells``: those that rays
        place in, 0 where they place nothing.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        n = settings.surfels
        counters = np.zeros(COUNT_WORDS, np.uint32)
        counters[COUNT_FREE] = n
        data = {
            # ID 0 lies on top.
            "surfel_free_ids": np.arange(n - 1, -1, -1, dtype=np.int64).astype(np.uint32),
            "surfel_counters": counters,
        }
        if bare_cells:
            data["bare_cell_ray"] = np.full(bare_cells, NO_RAY, np.uint32)
        held = device.allocate(Surfels.own(settings, bare_cells), data)
        scan = BlockScan.create(device, SCAN, n, workgroup_size)
        estimator = held["surfel_estimator"]
        geometry = SurfelGeometry.of(held, transforms, estimator)
        return Surfels(
            geometry=geometry,
            estimator=estimator,
            births=held["surfel_births"],
            seen=held["surfel_seen"],
            moments=held["surfel_moments"],
            guides=held["surfel_guides"],
            free_ids=held["surfel_free_ids"],
            counters=held["surfel_counters"],
            marks=held["surfel_marks"],
            before=held["surfel_before"],
            survivors=held["surfel_survivors"],
            scan=scan,
            ray_first=held["surfel_ray_first"],
            ray_owner=held["surfel_ray_owner"],
            ray_light=held["surfel_ray_light"],
            ray_choice=held["surfel_ray_choice"],
            ray_hit=held.get("bare_ray_hit"),
            cell_ray=held.get("bare_cell_ray"),
        )

    @staticmethod
    def buffers(
        settings: GibsSettings, workgroup_size: int, bare_cells: int = 0
    ) -> list[BufferSpec]:
        """The buffers of so many surfels and rays, the transforms left out."""
        scan = BlockScan.buffer(SCAN, settings.surfels, workgroup_size)
        return [*Surfels.own(settings, bare_cells), scan]

    @staticmethod
    def own(settings: GibsSettings, bare_cells: int = 0) -> list[BufferSpec]:
        """The buffers without the scan's."""
        n, rays = settings.surfels, most_rays(settings)

        def floats(name: str, *shape: int) -> BufferSpec:
            return BufferSpec.of(f"surfel_{name}", shape, np.float32)

        def words(name: str, *shape: int) -> BufferSpec:
            return BufferSpec.of(f"surfel_{name}", shape, np.uint32)

        bare = (
            [
                BufferSpec.of("bare_ray_hit", (rays, 4), np.float32),
                BufferSpec.of("bare_cell_ray", bare_cells, np.uint32),
            ]
            if bare_cells
            else []
        )
        return [
            floats("estimator", ESTIMATOR_ROWS, n),
            *SurfelGeometry.buffers(n, FRAME_WORDS),
            words("births", n),
            words("seen", n),
            floats("moments", n if settings.depth_moments else 1, MOMENT_FLOATS),
            floats("guides", n if settings.ray_guiding else 1, GUIDE_FLOATS),
            words("free_ids", n),
            words("counters", COUNT_WORDS),
            words("marks", n),
            words("before", n + 1),
            words("survivors", n),
            words("ray_first", n + 1),
            words("ray_owner", rays),
            floats("ray_light", rays, 4),
            floats("ray_choice", rays, 2),
            *bare,
        ]
