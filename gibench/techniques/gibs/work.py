"""The least every pass must do in a frame, from its sizes."""

from __future__ import annotations

from dataclasses import dataclass

from gibench.techniques.technique import Work

_TRANSFORM_FLOPS = 18 + 15 + 9 + 1  # a point, a direction, a distance, a radius
# The cells a surfel goes into (kernels_cl/parts/surfel_grid.cl), of a uniform grid and without its
# rows: a point's cell; or the ellipsoid's box, two points' cells and the slab.
_CELL_FLOPS = 6
_REACHED_FLOPS = 26 + 2 * 9 + 21
_ESTIMATOR_FLOPS = 90  # kernels_cl/gibs/estimator.cl, three channels
_WEIGHT_FLOPS = 30  # kernels_cl/gibs/gather.cl, one surfel and one point
_SURFEL_WORDS = 22  # what placement writes of a surfel, but moments and guide


@dataclass(frozen=True)
class FrameSizes:
    """What a frame's work depends on. What only the frame can tell is 0 before the first.

    Attributes:
        alive: surfels alive as it begins.
        rays: rays traced from surfels.
        pixels: of the image.
        tiles: that surfels are placed in.
        cells: of the grid.
        neighbours: whether a surfel goes into all neighbouring cells, as published.
        depth: whether depth moments are kept.
        guiding: whether rays are guided.
        by_rays: whether surfels are placed where rays hit bare surface.
        entries: in the grid's lists.
        surface: pixels that show a surface's front.
        covered: pixels that a surfel covers.
        placed: surfels placed.
    """

    alive: int
    rays: int
    pixels: int
    tiles: int
    cells: int
    neighbours: bool
    depth: bool
    guiding: bool
    by_rays: bool = False
    entries: int = 0
    surface: int = 0
    covered: int = 0
    placed: int = 0


def frame_work(sizes: FrameSizes) -> dict[str, Work]:
    """Work by pass. What depends on the scene (list lengths, shadow rays) is left out: these
    are lower bounds. Of a covered pixel's lookup one surfel is counted.
    """
    n, rays, pixels, cells = sizes.alive, sizes.rays, sizes.pixels, sizes.cells
    entries, new = sizes.entries, sizes.placed
    cell_flops = _CELL_FLOPS if sizes.neighbours else _REACHED_FLOPS
    # Each ray's mean, mean square and count of its texel; all means, for the least of them.
    moments = (4 * 16 * n + 4 * 2 * rays, 4 * n + 4 * 3 * rays) if sizes.depth else (0, 0)
    guide = 4 * 16 * n if sizes.guiding else 0
    record = 4 * (_SURFEL_WORDS + (49 if sizes.depth else 0) + (16 if sizes.guiding else 0))
    # As published neither normal nor radius matters, and the cursors alone say where to write.
    sorted_bytes = 16 * n if sizes.neighbours else 32 * n + 4 * min(cells, entries)
    return {
        "transform_and_count": Work(
            flops=n * (_TRANSFORM_FLOPS + cell_flops),
            bytes_read=n * 4 * 8,
            bytes_written=n * 4 * 7,
            atomics=entries,
        ),
        "prefix_sum": Work(bytes_read=4 * cells, bytes_written=4 * cells),
        "finalise": Work(
            flops=n * cell_flops,
            bytes_read=sorted_bytes,
            bytes_written=4 * entries,
            atomics=entries,
        ),
        # A surfel's ID, estimator, last sight, place, normal and radius.
        "irradiance": Work(
            flops=rays * _ESTIMATOR_FLOPS,
            bytes_read=n * 4 * (1 + 12 + 1 + 3 + 3 + 1) + moments[0] + guide,
            bytes_written=n * 4 * 12 + moments[1] + (4 * rays if sizes.guiding else 0),
            rays=rays,
        ),
        "application": Work(
            flops=sizes.covered * _WEIGHT_FLOPS,
            bytes_read=pixels * 4 * 4 + sizes.surface * 4 * 3 + sizes.covered * 4 * 3,
            bytes_written=pixels * 4 * 7,
        ),
        "coverage": Work(
            flops=sizes.surface,
            bytes_read=4 * (pixels + sizes.surface),
            bytes_written=4 * sizes.tiles,
        ),
        "placement": Work(
            flops=33 * new,
            bytes_read=4 * (sizes.tiles + (cells if sizes.by_rays else 0)) + new * 4 * (1 + 4 + 3),
            bytes_written=record * new,
        ),
        # Every surfel draws by its ID and number; what stays keeps its place in the list.
        "recycling": Work(bytes_read=(n + new) * 4 * 2, bytes_written=(n + new) * 4),
    }
