"""The light that compression is judged under: every patch of the scene shining on its own.

Compression is to keep irradiance, not coefficients (Silvennoinen and Lehtinen 2017, section 5.2,
measure errors in "the final result we seek" likewise). Irradiance is transport times the probes'
radiance, and that is no vector of independent numbers: probes near each other see the same
surfaces. So the surfaces are cut into patches, the sky into cells, and each of them is given
radiance of its own, independent of the others and equally likely: materials and lights may change
at runtime, so that none can be told to stay dark.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gibench.arrays import Floats, Ints
from gibench.scene.lightmap import Lightmap
from gibench.techniques.srp.bake.cpca import aabb_clusters
from gibench.techniques.srp.bake.data import RelightSamples

# Patches of a scene, about, before they are cut by the way they face: some 5600 then on Sponza.
PATCHES = 1000
# Rows of equal solid angle, and columns, of the sky's cells.
SKY_ROWS, SKY_COLUMNS = 8, 16


@dataclass(frozen=True)
class ExpectedLight:
    """Which patch each relight ray sees.

    Attributes:
        patch: (p, s) int32 patch or sky cell of each probe's relight rays; -1: black.
        basis: (s, c) float32: the relight samples' weighted basis.
    """

    patch: Ints = field(repr=False)
    basis: Floats = field(repr=False)

    def columns(self, probes: Ints) -> Floats:
        """(k * c, q) float32: radiance of ``probes`` (k,) under unit radiance of each of the q
        patches that any of them sees.
        """
        seen = np.unique(self.patch[probes])
        seen = seen[seen >= 0]
        out = np.zeros((len(probes), self.basis.shape[1], len(seen)), np.float32)
        for row, patch in zip(out, self.patch[probes], strict=True):
            order = np.argsort(patch, kind="stable")
            order = order[np.searchsorted(patch[order], 0) :]
            if len(order):
                of, first = np.unique(patch[order], return_index=True)
                sums = np.add.reduceat(self.basis[order], first, axis=0)
                row[:, np.searchsorted(seen, of)] = sums.T
        return out.reshape(len(probes) * self.basis.shape[1], len(seen))


def expected_light(lightmap: Lightmap, relight: RelightSamples) -> ExpectedLight:
    """The patches of the scene behind ``lightmap`` as ``relight`` sees them."""
    receivers = lightmap.receivers
    facing = np.abs(receivers.normal).argmax(axis=1)
    facing = 2 * facing + (np.take_along_axis(receivers.normal, facing[:, None], 1)[:, 0] > 0)
    of_texel = np.full(lightmap.width * lightmap.height, -1, np.int32)
    count = 0
    for members in aabb_clusters(receivers.position, max(1, len(receivers) // PATCHES)):
        sides, side = np.unique(facing[members], return_inverse=True)
        of_texel[receivers.texel[members]] = count + side
        count += len(sides)
    x, y, z = relight.directions.T.astype(np.float64)
    row = np.clip(0.5 * (z + 1.0) * SKY_ROWS, 0, SKY_ROWS - 1).astype(np.int32)
    turn = np.arctan2(y, x) / (2.0 * np.pi) % 1.0
    column = np.clip(turn * SKY_COLUMNS, 0, SKY_COLUMNS - 1).astype(np.int32)
    sky = count + row * SKY_COLUMNS + column
    patch = np.where(relight.texel >= 0, of_texel[np.maximum(relight.texel, 0)], -1)
    patch = np.where(relight.texel == -1, sky, patch)
    return ExpectedLight(patch.astype(np.int32), relight.basis)
