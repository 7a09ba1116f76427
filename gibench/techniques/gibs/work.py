"""The least every pass must do in a frame, from its sizes."""

from __future__ import annotations

from dataclasses import dataclass

from gibench.techniques.gibs.grid import NEIGHBOURS
from gibench.techniques.technique import Work

_TRANSFORM_FLOPS = 18 + 15 + 6  # a point, a direction, a distance
_ESTIMATOR_FLOPS = 90  # kernels_cl/gibs/estimator.cl, three channels
_WEIGHT_FLOPS = 30  # kernels_cl/gibs/gather.cl, one surfel and one point


@dataclass(frozen=True)
class FrameSizes:
    """What a frame's work depends on.

    Attributes:
        alive: surfels alive.
        rays: rays traced from surfels.
        pixels: of the image.
        cells: of the grid.
        neighbours: whether a surfel goes into all neighbouring cells; else it counts as one cell,
            since how many it reaches is not known ahead.
        depth: whether depth moments are kept.
        guiding: whether rays are guided.
    """

    alive: int
    rays: int
    pixels: int
    cells: int
    neighbours: bool
    depth: bool
    guiding: bool


def frame_work(sizes: FrameSizes) -> dict[str, Work]:
    """Work by pass. What depends on the scene (list lengths, shadow rays) is left out: these
    are lower bounds. Of a pixel's lookup one surfel is counted: it is covered.
    """
    n, rays, pixels, cells = sizes.alive, sizes.rays, sizes.pixels, sizes.cells
    entries = n * (NEIGHBOURS if sizes.neighbours else 1)
    record = 4 * (48 if sizes.depth else 0) + 4 * (16 if sizes.guiding else 0)
    return {
        "transform_and_count": Work(
            flops=n * _TRANSFORM_FLOPS,
            bytes_read=n * 4 * 8,
            bytes_written=n * 4 * 7,
            atomics=entries,
        ),
        "prefix_sum": Work(bytes_read=4 * cells, bytes_written=4 * cells),
        "finalise": Work(
            bytes_read=n * 4 * 8 + 4 * cells, bytes_written=4 * entries, atomics=entries
        ),
        "irradiance": Work(
            flops=rays * _ESTIMATOR_FLOPS,
            bytes_read=n * (4 * 21 + record),
            bytes_written=n * (4 * 12),
            rays=rays,
        ),
        "gbuffer": Work(bytes_written=pixels * 4 * 15, rays=pixels),
        "application": Work(
            flops=pixels * _WEIGHT_FLOPS,
            bytes_read=pixels * 4 * 15,
            bytes_written=pixels * 4 * 7,
        ),
        "coverage": Work(bytes_read=pixels * 4 * 2, bytes_written=pixels / 64),
        "placement": Work(bytes_read=pixels / 64),
        "recycling": Work(bytes_read=n * 4 * 3, bytes_written=n * 4),
    }
