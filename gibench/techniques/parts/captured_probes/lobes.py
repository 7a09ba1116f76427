"""Radiance prefiltered for gloss: how many maps of what size, and the maps of probes lit once.

One map a step of roughness, as kernels_cl/parts/captured_lobes.cl has them: step k of n is of
roughness k / (n - 1), from a mirror, whose map is the radiance itself, to the roughest; each is
half as wide as the one before, as a rougher surface's lobe is wider (Anonymous 2022, section 4.2.3,
which takes mipmaps for it).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gibench.arrays import Floats
from gibench.device import BufferSpec
from gibench.scene.gloss import LEAST_ALPHA
from gibench.techniques.parts.captured_probes.maps import (
    bordered,
    texel_directions,
    texel_solid_angles,
)
from gibench.techniques.parts.octahedral_maps import OctahedralMaps

LEAST_SIDE = 8
"""Texels of the side of the roughest step's map, at least."""
_ROWS = 1024  # of weights at once


def lobe_sides(side: int, steps: int) -> tuple[int, ...]:
    """Texels of the maps' sides, of a radiance map of ``side`` texels."""
    return tuple(max(side >> step, min(side, LEAST_SIDE)) for step in range(steps))


def lobe_texels(side: int, steps: int) -> int:
    """Texels of all steps of a probe, without borders."""
    return sum(own**2 for own in lobe_sides(side, steps))


def lobe_maps(side: int, steps: int, storage: str) -> tuple[OctahedralMaps, ...]:
    """Of every probe, a step each."""
    return tuple(OctahedralMaps(own, 4, storage) for own in lobe_sides(side, steps))


def lobe_buffer(side: int, steps: int, storage: str, probes: int) -> BufferSpec:
    """All steps one after the other: (texels, 4)."""
    texels = sum(probes * (own + 2) ** 2 for own in lobe_sides(side, steps))
    return BufferSpec.of("lobe_maps", (texels, 4), OctahedralMaps(side, 4, storage).dtype)


def lobe_alpha(step: int, steps: int) -> float:
    """Of the distribution: roughness squared."""
    return max((step / (steps - 1)) ** 2, LEAST_ALPHA)


def prefiltered(radiance: Floats, side: int, steps: int) -> tuple[Floats, ...]:
    """The maps (p, t, 3) of each step, W/m2/sr, of radiance maps (p, side^2, 3).

    The mean of radiance by D(h) n . l, where the eye looks along the normal n (Karis 2013).
    """
    probes, texels, _ = radiance.shape
    source = texel_directions(side).astype(np.float32)
    angles = texel_solid_angles(side).astype(np.float32)
    columns = np.ascontiguousarray(radiance.transpose(1, 0, 2).reshape(texels, 3 * probes))
    found = [radiance]
    for step, own in list(enumerate(lobe_sides(side, steps)))[1:]:
        targets = texel_directions(own).astype(np.float32)
        squared = np.float32(lobe_alpha(step, steps) ** 2)
        sent = np.empty((len(targets), 3 * probes), np.float32)
        for begin in range(0, len(targets), _ROWS):
            part = slice(begin, begin + _ROWS)
            cosine = targets[part] @ source.T
            off = np.float32(0.5) - np.float32(0.5) * cosine
            weights = np.maximum(cosine, 0) * angles / (off + squared * (1 - off)) ** 2
            sent[part] = (weights @ columns) / weights.sum(axis=1, keepdims=True)
        found.append(sent.reshape(len(targets), probes, 3).transpose(1, 0, 2))
    return tuple(found)


def stored_lobes(lobes: Sequence[Floats], side: int) -> Floats:
    """The maps of all steps with their borders as they lie in the buffer, (texels, 4)."""
    sides = lobe_sides(side, len(lobes))
    rows = [bordered(own, width).reshape(-1, 3) for own, width in zip(lobes, sides, strict=True)]
    found = np.zeros((sum(len(own) for own in rows), 4), np.float32)
    found[:, :3] = np.concatenate(rows)
    return found
