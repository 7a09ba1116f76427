"""The surfels' buffers: preallocated, structure of arrays, with a stack of free IDs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gibench.device import Buffer, Device
from gibench.techniques.gibs.settings import GibsSettings
from gibench.techniques.parts.scan import BlockScan
from gibench.techniques.parts.surfels import SurfelGeometry

FRAME_WORDS = 10  # kernels_cl/gibs/frame.cl
COUNT_WORDS = 5
COUNT_ALIVE, COUNT_FREE, COUNT_PLACED, COUNT_RECYCLED = range(4)
ESTIMATOR_ROWS = 12  # kernels_cl/gibs/estimator.cl
MOMENT_FLOATS = 48  # kernels_cl/gibs/depth.cl
GUIDE_FLOATS = 16


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

    @staticmethod
    def create(
        device: Device, settings: GibsSettings, transforms: Buffer, workgroup_size: int
    ) -> Surfels:
        """Room for ``settings.surfels`` surfels, none placed, that go with their objects, whose
        ``transforms`` (objects, 12) to the world are not its own.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        n, rays = settings.surfels, most_rays(settings)
        counters = np.zeros(COUNT_WORDS, np.uint32)
        counters[COUNT_FREE] = n

        def floats(name: str, *shape: int) -> Buffer:
            return device.empty(f"surfel_{name}", shape, np.float32)

        def words(name: str, *shape: int) -> Buffer:
            return device.empty(f"surfel_{name}", shape, np.uint32)

        estimator = floats("estimator", ESTIMATOR_ROWS, n)
        geometry = SurfelGeometry(
            frame=words("frame", FRAME_WORDS),
            alive_ids=words("alive_ids", n),
            object_ids=device.empty("surfel_object_ids", n, np.int32),
            transforms=transforms,
            local_position=floats("local_position", 3, n),
            local_normal=floats("local_normal", 3, n),
            world_position=floats("world_position", 3, n),
            world_normal=floats("world_normal", 3, n),
            radii=floats("radii", n),
            mean=estimator,
            nearest=floats("nearest", n),
        )
        return Surfels(
            geometry=geometry,
            estimator=estimator,
            births=words("births", n),
            seen=words("seen", n),
            moments=floats("moments", n if settings.depth_moments else 1, MOMENT_FLOATS),
            guides=floats("guides", n if settings.ray_guiding else 1, GUIDE_FLOATS),
            # ID 0 lies on top.
            free_ids=device.upload(
                "surfel_free_ids", np.arange(n - 1, -1, -1, dtype=np.int64).astype(np.uint32)
            ),
            counters=device.upload("surfel_counters", counters),
            marks=words("marks", n),
            before=words("before", n + 1),
            survivors=words("survivors", n),
            scan=BlockScan.create(device, "surfel_scan", n, workgroup_size),
            ray_first=words("ray_first", n + 1),
            ray_owner=words("ray_owner", rays),
            ray_light=floats("ray_light", rays, 4),
            ray_choice=floats("ray_choice", rays, 2),
        )

    @staticmethod
    def bytes_of(settings: GibsSettings, workgroup_size: int) -> int:
        """Bytes it takes, in closed form, without the transforms."""
        n, rays = settings.surfels, most_rays(settings)
        per_surfel = 2 + 12 + 1 + 1 + ESTIMATOR_ROWS + 2 + 1 + 1 + 1 + 1 + 1
        words = n * per_surfel + 2 + FRAME_WORDS + COUNT_WORDS
        words += MOMENT_FLOATS * (n if settings.depth_moments else 1)
        words += GUIDE_FLOATS * (n if settings.ray_guiding else 1)
        words += max(BlockScan.blocks(n, workgroup_size), 1) + 7 * rays
        return 4 * words
