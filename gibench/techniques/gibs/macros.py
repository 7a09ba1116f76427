"""Constants that GIBS's kernels (kernels_cl/gibs) and the host share: each has its home here, and
kernels get it as a macro.
"""

from __future__ import annotations

from gibench.device import Define
from gibench.device.build import unsigned_literal
from gibench.techniques.parts.scan import SCAN_MACROS
from gibench.techniques.parts.surfel_grid import LIST_MACROS
from gibench.techniques.parts.surfels import SURFEL_WORDS

FRAME_NUMBER, FRAME_RAYS, FRAME_SEED = range(SURFEL_WORDS, SURFEL_WORDS + 3)
"""Words of a frame behind those of every technique with surfels: frames begun so far, from 1; rays
to trace in this one; the seed of every random choice.
"""
FRAME_WORDS = FRAME_SEED + 1

COUNT_ALIVE, COUNT_FREE, COUNT_PLACED, COUNT_RECYCLED, COUNT_SURVIVORS = range(5)
"""Counters: surfels alive; height of the stack of free IDs; surfels placed in this frame, recycled
in it, alive after it.
"""
COUNT_WORDS = COUNT_SURVIVORS + 1

ESTIMATOR_ROWS = 12
"""Numbers of a surfel's estimator."""
LONGEST_WINDOW = 256
"""Rays that a surfel's mean holds: what its least blend would come to if the blend factor did not
lower it (the listing of Barre-Brisebois et al. 2019).
"""

HEMISPHERE_SIDE = 4
"""Texels of the side of a surfel's hemisphere."""
HEMISPHERE_TEXELS = HEMISPHERE_SIDE**2
MOMENT_FLOATS = 3 * HEMISPHERE_TEXELS
"""Per surfel: of each texel the mean distance, m, the mean squared distance, the rays."""
GUIDE_FLOATS = HEMISPHERE_TEXELS
"""Per surfel: of each texel the mean brightness."""
GUIDE_UNIFORM = 0.5
"""Chance that guiding leaves the choice of direction to the cosine, so that none is left out and no
ray weighs more than twice; ours.
"""
GUIDE_FIRST_RAYS = 64
"""Rays, by the cosine, before a surfel's guide guides: a texel that no ray has been sent to is no
dark one, and the guide would send three quarters of the rays to the first bright texel; ours.
"""

VISIBLE_FRAMES = 16
"""A surfel seen within so many frames counts as visible: application marks every pixel once in as
many.
"""

PLACEMENT_TILE = 16
"""Pixels of the side of a tile: a surfel at most is placed in each."""
NO_PIXEL = 0xFFFFFFFF
"""In place of a tile's least covered pixel, where it shows no surface."""
COVERAGE_STEPS = 4096
"""Coverage is compared in steps of one over it, so that a pixel right on a surfel, whose weight is
1 but for rounding, counts as covered once.
"""
COVERAGE_MOST = 2**24 - 1
"""The most steps that are told apart."""

NO_RAY = 0xFFFFFFFF
"""In place of the ray that is taken in a cell, where there is none."""
KEY_FACTOR = 0x9E3779B1
"""A ray's key is its number times this, modulo 2^32, after some bits are turned: one to one, in an
order that changes with the frame.
"""

GIBS_MACROS: dict[str, Define] = {
    **SCAN_MACROS,
    **LIST_MACROS,
    "FRAME_NUMBER": FRAME_NUMBER,
    "FRAME_RAYS": FRAME_RAYS,
    "FRAME_SEED": FRAME_SEED,
    "COUNT_ALIVE": COUNT_ALIVE,
    "COUNT_FREE": COUNT_FREE,
    "COUNT_PLACED": COUNT_PLACED,
    "COUNT_RECYCLED": COUNT_RECYCLED,
    "COUNT_SURVIVORS": COUNT_SURVIVORS,
    "LONGEST_WINDOW": float(LONGEST_WINDOW),
    "HEMISPHERE_SIDE": HEMISPHERE_SIDE,
    "GUIDE_UNIFORM": GUIDE_UNIFORM,
    "GUIDE_FIRST_RAYS": float(GUIDE_FIRST_RAYS),
    "VISIBLE_FRAMES": VISIBLE_FRAMES,
    "PLACEMENT_TILE": PLACEMENT_TILE,
    "NO_PIXEL": unsigned_literal(NO_PIXEL),
    "COVERAGE_STEPS": float(COVERAGE_STEPS),
    "COVERAGE_MOST": unsigned_literal(COVERAGE_MOST),
    "NO_RAY": unsigned_literal(NO_RAY),
    "KEY_FACTOR": unsigned_literal(KEY_FACTOR),
    "KEY_INVERSE": unsigned_literal(pow(KEY_FACTOR, -1, 2**32)),
}
"""Of every program in kernels_cl/gibs."""
