"""Places whose materials change, against the sum of their shares in float64."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from gibench.arrays import Array
from gibench.device import ProgramSpec, updates
from gibench.techniques.parts.conformance.case import Bench, Case, off, run
from gibench.techniques.parts.macros import SCENE_MACROS
from gibench.techniques.parts.material_table import MATERIAL_FLOATS
from gibench.techniques.parts.recolouring import Recolouring, Shares
from gibench.techniques.surfel_cache.shared_exponent import SHARED_MACROS, decode

RECEIVERS = "parts/recolour_receivers"
CAPTURED = "parts/recolour_captured"
SURFELS = "surfel_cache/recolour"
KINDS = (RECEIVERS, CAPTURED, SURFELS)
PLACES, OF, ROWS = 333, 400, 6
ROUNDING = 2e-6
"""Of single precision: four products and sums of positive values."""


def random_shares(rng: np.random.Generator) -> Shares:
    """``PLACES`` of ``OF`` places that show up to four of ``ROWS`` materials."""
    counts = rng.integers(1, 5, PLACES)
    entries = int(counts.sum())
    return Shares(
        np.sort(rng.choice(OF, PLACES, replace=False)).astype(np.int32),
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
        rng.integers(0, ROWS, entries).astype(np.int32),
        rng.uniform(0, 0.3, (entries, 4)).astype(np.float32),
        rng.uniform(0, 0.1, (PLACES, 2, 3)).astype(np.float32),
    )


def colours(shares: Shares, materials: Array) -> Array:
    """Albedo and emission of places (n, 2, 3)."""
    owner = np.repeat(np.arange(len(shares.places)), np.diff(shares.starts))
    found = shares.rest.astype(np.float64)
    share = shares.shares.astype(np.float64)
    np.add.at(found[:, 0], owner, share[:, :3] * materials[shares.rows, :3])
    np.add.at(found[:, 1], owner, share[:, 3:] * materials[shares.rows, 3:6])
    return found


def recoloured(bench: Bench, rng: np.random.Generator, size: int, kind: str) -> Iterator[float]:
    """Halves round by 2^-11 of themselves, surfels by half a 1023rd and by half of a 512th of their
    brightest channel. What does not change is left alone.
    """
    device, shares = bench.open(), random_shares(rng)
    materials = rng.uniform(0, 1, (ROWS, MATERIAL_FLOATS)).astype(np.float32)
    materials[:, 3:6] *= 5
    before = rng.integers(1, 1 << 10, (OF, 4))
    names, dtype, wide = {
        RECEIVERS: (("albedo", "emission"), np.float32, 3),
        CAPTURED: (("captured_albedo", "captured_emission"), np.float16, 4),
        SURFELS: (("surfel_albedo", "surfel_emission"), np.uint32, 1),
    }[kind]
    start = before[:, :wide].astype(dtype)
    held = [device.upload(name, start.copy()) for name in names]
    store = tuple(updates(name, one) for name, one in zip(names, held, strict=True))
    table = device.upload("materials", materials)
    program = ProgramSpec(f"{kind}.cl", {**SCENE_MACROS, **SHARED_MACROS})
    recolouring = Recolouring.create(device, shares, table, program, store, 24)
    assert recolouring is not None
    for item in recolouring.passes():
        run(device, item.launches(), size)
    found = [device.read(one) for one in held]
    others = np.setdiff1d(np.arange(OF), shares.places)
    for one in found:
        yield off(one[others], start[others])
    wanted = colours(shares, materials)
    albedo, emission = (one[shares.places] for one in found)
    if kind == SURFELS:
        q = np.stack([albedo[:, 0] >> s & 1023 for s in (0, 10, 20)], axis=1)
        yield off(q, np.clip(wanted[:, 0], 0, 1) * 1023, absolute=0.5 + 1e-3)
        step = np.maximum(wanted[:, 1].max(axis=1), 2.0**-16)[:, None] / 512
        yield float((np.abs(decode(emission[:, 0]) - wanted[:, 1]) / (1.001 * step)).max())
        return
    relative = ROUNDING + (2.0**-11 if kind == CAPTURED else 0.0)
    yield off(albedo[:, :3], wanted[:, 0], relative, 1e-7)
    yield off(emission[:, :3], wanted[:, 1], relative, 1e-7)


CASES = [
    Case(
        f"Materials that change ({kind})",
        ("parts/recolour.cl:recolour",),
        partial(recoloured, kind=kind),
    )
    for kind in KINDS
]
