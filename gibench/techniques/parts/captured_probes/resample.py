"""From a cube's texels to an octahedral map's, by the sharpness weight.

A captured texel counts for a map's texel by (d_map . d_captured)^sharpness; the map holds the mean.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from gibench.arrays import Doubles, Floats, Ints, Longs
from gibench.techniques.parts.captured_probes.capture import Captured

# Captured texels that weigh less than this share of the nearest are left out: together they have
# about this share of all weight, since the tail of cos^n beyond weight w has the share w.
LEAST_WEIGHT = 1e-4
_RIGHT_ANGLE = 1e-9  # cosines up to which rounding decides on which side a direction lies
_BLOCK = 4_000_000  # pairs of texels that are weighed at once
_HELD = 40_000_000  # pairs up to which weights are kept for the next probe


@dataclass(frozen=True)
class Resampling:
    """Weights of sources for targets: the same for every probe.

    Attributes:
        targets: (t, 3) unit directions.
        sources: (s, 3) unit directions.
        sharpness: power of the cosine.
        nearest: (t,) the source nearest to each target.
        held: the weights, blocks of rows that sum to 1; None where they are too many.
    """

    targets: Doubles = field(repr=False)
    sources: Doubles = field(repr=False)
    sharpness: float
    nearest: Longs = field(repr=False)
    held: tuple[csr_array, ...] | None = field(repr=False)

    @staticmethod
    def of(targets: Doubles, sources: Doubles, sharpness: float) -> Resampling:
        """The weights; kept where they are few enough."""
        _, nearest = cKDTree(sources).query(targets)
        made = Resampling(targets, sources, sharpness, np.asarray(nearest, np.int64), None)
        if made.pairs > _HELD:
            return made
        held = tuple(made.blocks())
        return Resampling(targets, sources, sharpness, made.nearest, held)

    @property
    def pairs(self) -> float:
        """About how many weights there are: a share of the sphere's sources for each target."""
        return len(self.targets) * max(1.0, len(self.sources) * self._reach() ** 2 / 4)

    def blocks(self) -> Iterator[csr_array]:
        """The weights, some rows at a time, each (rows, s) float32."""
        if self.held is not None:
            yield from self.held
            return
        sources = cKDTree(self.sources)
        reach = self._reach()
        rows = max(1, int(_BLOCK / (self.pairs / len(self.targets))))
        closest = np.einsum("tx,tx->t", self.targets, self.sources[self.nearest])
        for begin in range(0, len(self.targets), rows):
            own = self.targets[begin : begin + rows]
            found = cKDTree(own).sparse_distance_matrix(sources, reach, output_type="ndarray")
            row, column = found["i"], found["j"]
            cosine = np.einsum("nx,nx->n", own[row], self.sources[column])
            weight = self._weight(cosine, closest[begin : begin + rows][row])
            matrix = csr_array((weight, (row, column)), (len(own), len(self.sources)))
            matrix.eliminate_zeros()
            total: Doubles = np.asarray(matrix.sum(axis=1)).ravel()
            matrix.data /= np.repeat(total, np.diff(matrix.indptr))
            yield matrix.astype(np.float32)

    def apply(self, values: Floats) -> Doubles:
        """Means (t, c) of ``values`` (s, c)."""
        return np.concatenate([np.asarray(block @ values, np.float64) for block in self.blocks()])

    def strongest(self, wanted: npt.NDArray[np.bool_]) -> Longs:
        """(t,) the source among those ``wanted`` (s,) that weighs most; -1 where none weighs."""
        found = np.where(wanted[self.nearest], self.nearest, -1)
        begin = 0
        for block in self.blocks():
            for row in np.flatnonzero(found[begin : begin + block.shape[0]] < 0):
                part = slice(block.indptr[row], block.indptr[row + 1])
                own = block.indices[part]
                weight = np.where(wanted[own], block.data[part], 0.0)
                if len(weight) and weight.max() > 0:
                    found[begin + row] = own[weight.argmax()]
            begin += block.shape[0]
        return found

    def _weight(self, cosine: Doubles, closest: Doubles) -> Doubles:
        """Weights over the nearest source's, so that none is too small for a number."""
        share = np.maximum(cosine, 1e-300) / closest
        weight = np.exp(self.sharpness * np.log(share))
        return np.where((weight >= LEAST_WEIGHT) & (cosine > _RIGHT_ANGLE), weight, 0.0)

    def _reach(self) -> float:
        """Chord to the farthest source that counts for any target."""
        closest = np.einsum("tx,tx->t", self.targets, self.sources[self.nearest]).min()
        share = LEAST_WEIGHT ** (1 / self.sharpness) if self.sharpness > 0 else 0.0
        return float(np.sqrt(2 - 2 * max(0.0, closest * share)) + 1e-9)


@dataclass(frozen=True)
class ProbeMaps:
    """A probe's G-buffer as octahedral maps, texel by texel.

    Attributes:
        triangle: (t,) int32 whose front a texel shows; -1 where it shows none.
        barycentric: (t, 2) float32 weights of its corners 1 and 2 there.
        albedo: (t, 3) float32, mean over all that the texel shows: what is no front has none.
        emission: (t, 3) float32 likewise, W/m2/sr; the environment's where it is seen.
        moments: (t, 2) float32 mean distance and mean squared distance, in units of the far plane's
            distance, which nothing exceeds.
        back_share: share of captured texels that show backs.
        captured_bytes: of the cube's faces, which are not kept.
    """

    triangle: Ints = field(repr=False)
    barycentric: Floats = field(repr=False)
    albedo: Floats = field(repr=False)
    emission: Floats = field(repr=False)
    moments: Floats = field(repr=False)
    back_share: float
    captured_bytes: int


def resampled(captured: Captured, resampling: Resampling, far: float) -> ProbeMaps:
    """The maps of a captured cube.

    Args:
        captured: the cube.
        resampling: from its texels to the maps'.
        far: distance of the far plane, m.
    """
    distance = np.minimum(captured.distance / np.float32(far), np.float32(1.0))
    columns = [captured.albedo, captured.emission, np.stack([distance, distance**2], axis=1)]
    mean = resampling.apply(np.concatenate(columns, axis=1).astype(np.float32))
    shown = resampling.strongest(captured.front)
    place = np.maximum(shown, 0)
    return ProbeMaps(
        triangle=np.where(shown >= 0, captured.triangle[place], -1).astype(np.int32),
        barycentric=captured.barycentric[place],
        albedo=mean[:, :3].astype(np.float32),
        emission=mean[:, 3:6].astype(np.float32),
        moments=mean[:, 6:].astype(np.float32),
        back_share=captured.back_share,
        captured_bytes=captured.nbytes,
    )
