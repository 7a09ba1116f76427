"""What SRP's kernels are held against: float64 NumPy on random baked data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gibench.arrays import Array
from gibench.device import Buffer, Launch
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.parts.conformance.synthetic import random_unit
from gibench.techniques.srp.bake.data import Cluster, ProbeSet, RelightSamples, SrpBake
from gibench.techniques.srp.bake.sh import sh_basis
from gibench.techniques.srp.bake.weights import spatial_weight
from gibench.techniques.srp.probe_light import DEPTH_BIAS, DEPTH_SIDE, LEAST_SEEN, with_borders
from gibench.techniques.srp.storage import store_cluster, stored_values

LEAST_WEIGHT = 1e-3
"""All probes in reach together under this: single precision knows no three digits of it."""


def random_bake(
    rng: np.random.Generator,
    lightmap: Lightmap,
    *,
    order: int = 7,
    probes: int = 11,
    samples: int = 100,
    clusters: int = 5,
    reach: int = 4,
    vectors: tuple[int, int] = (1, 32),
    dark: bool = True,
    receiver_order: int = 0,
) -> SrpBake:
    """Clusters of random matrices whose values span several powers of two, some of them dark."""
    n, c = len(lightmap.receivers), (order + 1) ** 2
    cuts = np.sort(rng.choice(np.arange(1, n), clusters - 1, replace=False))
    parts = np.split(rng.permutation(n).astype(np.int32), cuts)
    made = []
    for i, members in enumerate(parts):
        k = min(reach, probes)
        outputs = len(members) * (receiver_order + 1) ** 2
        rows = min(int(rng.integers(vectors[0], vectors[1] + 1)), outputs, k * c)
        if dark and i == 1:
            rows = 0
        decay = 2.0 ** -rng.uniform(0, 6, (rows, 1))
        made.append(
            Cluster(
                members,
                np.sort(rng.choice(probes, k, replace=False)).astype(np.int32),
                (decay * rng.normal(size=(rows, k * c))).astype(np.float32),
                rng.normal(size=(outputs, rows), scale=0.1).astype(np.float32),
                0.0,
            )
        )
    directions = random_unit(rng, samples)
    texel = rng.choice(lightmap.receivers.texel, (probes, samples)).astype(np.int32)
    kind = rng.random((probes, samples))
    texel[kind < 0.3] = -1
    texel[kind < 0.1] = -2
    return SrpBake(
        order,
        ProbeSet(rng.uniform(-1, 1, (probes, 3)).astype(np.float32), 1.0),
        RelightSamples(
            directions,
            (sh_basis(order, directions) * 4 * np.pi / samples).astype(np.float32),
            texel,
        ),
        tuple(made),
        1.0,
        10.0,
        receiver_order,
    )


def expected_probe_radiance(scene: Scene, bake: SrpBake, radiance: Array) -> Array:
    """lambda (p, c, 3) of a map (texels, 3), in float64."""
    relight = bake.relight
    environment = scene.environment.radiance(relight.directions)
    seen = np.where(
        (relight.texel >= 0)[..., None], radiance[np.maximum(relight.texel, 0)], environment
    )
    seen[relight.texel == -2] = 0
    return np.asarray(np.einsum("psk,sj->pjk", seen, relight.basis.astype(np.float64)))


def expected_irradiance(bake: SrpBake, radiance: Array, count: int, storage: str) -> Array:
    """Irradiance (n, 3) of the receivers from lambda (p, c, 3), stored matrices, in float64."""
    return np.asarray(expected_signal(bake, radiance, count, storage)[:, 0])


def expected_signal(bake: SrpBake, radiance: Array, count: int, storage: str) -> Array:
    """The light at the receivers (n, components, 3), likewise."""
    out = np.zeros((count, bake.components, 3))
    for cluster in bake.clusters:
        if len(cluster.projection) == 0:
            continue
        stored = store_cluster(cluster, storage)
        light = radiance[cluster.probes].reshape(-1, 3)
        basis = stored_values(stored.projection, storage) @ light * stored.scale[:, None]
        light = stored_values(stored.reconstruction, storage) @ basis
        out[cluster.receivers] = light.reshape(len(cluster.receivers), -1, 3)
    return out


def write_lambda(technique: Any, radiance: Array) -> None:
    """Put lambda (p, c, 3) where the variant keeps it."""
    buffer = technique.variant._lambda
    if buffer.shape[1] == 3 and buffer.shape != radiance.shape:
        planes = np.zeros(buffer.shape, np.float32)
        planes[:, :, : radiance.shape[1]] = radiance.transpose(0, 2, 1)
        radiance = planes
    technique.device.write(buffer, radiance)


def looked_up(maps: Array, probe: int, direction: Array) -> Array:
    """A bordered octahedral map at unit directions (n, 3), bilinear, in float64."""
    d = direction / np.abs(direction).sum(axis=1, keepdims=True)
    sign = np.where(d[:, :2] >= 0, 1.0, -1.0)
    square = np.where(d[:, 2:] >= 0, d[:, :2], (1 - np.abs(d[:, 1::-1])) * sign)
    at = (square * 0.5 + 0.5) * DEPTH_SIDE + 0.5
    corner = np.clip(np.floor(at), 0, DEPTH_SIDE).astype(int)
    x, y = (at - corner).T[:, :, None]
    c, r = corner.T
    m = maps[probe]
    top = m[r, c] * (1 - x) + m[r, c + 1] * x
    return np.asarray(top * (1 - y) + (m[r + 1, c] * (1 - x) + m[r + 1, c + 1] * x) * y)


def probe_light(
    bake: SrpBake, maps: Array, radiance: Array, position: Array, normal: Array
) -> tuple[Array, Array]:
    """Irradiance (n, 3) at points, and the weight (n,) of the probes in reach.

    Args:
        bake: whose probes they are.
        maps: (p, s + 2, s + 2, 2) mean distance and mean squared distance.
        radiance: (p, c, 3) of the probes.
        position: (n, 3), m.
        normal: (n, 3).
    """
    c = min(9, bake.coefficients)
    factor = np.array([np.pi, *[2 * np.pi / 3] * 3, *[np.pi / 4] * 5])[:c]
    basis = sh_basis(bake.sh_order, normal)[:, :c] * factor
    total, weights = np.zeros((len(position), 3)), np.zeros(len(position))
    apart = position[:, None] - bake.probes.positions.astype(np.float64)
    distance = np.linalg.norm(apart, axis=2)
    each = np.einsum("nc,pck->pnk", basis, radiance[:, :c].astype(np.float64)).clip(0)
    for probe in range(len(bake.probes)):
        d = distance[:, probe]
        moments = looked_up(maps, probe, apart[:, probe] / d[:, None])
        behind = d - DEPTH_BIAS * bake.probes.radius - moments[:, 0]
        variance = np.abs(moments[:, 1] - moments[:, 0] ** 2)
        bound = np.maximum((variance / (variance + behind**2)) ** 3, LEAST_SEEN)
        weight = spatial_weight(d / bake.probes.radius) * np.where(behind > 0, bound, 1.0)
        total += weight[:, None] * each[probe]
        weights += weight
    nearest = distance.argmin(axis=1)
    alone = each[nearest, np.arange(len(position))]
    inside = weights > 0
    return np.where(inside[:, None], total / np.maximum(weights, 1e-30)[:, None], alone), weights


def probes_told(bake: SrpBake, position: Array, weights: Array) -> Array:
    """Points (n,) whose light single precision knows: enough probes in reach, or surely none, and
    one of them surely the nearest.
    """
    distance = np.linalg.norm(position[:, None] - bake.probes.positions, axis=2)
    ordered = np.sort(distance, axis=1)
    alone = (ordered[:, 0] > 1.001 * bake.probes.radius) & (np.diff(ordered[:, :2])[:, 0] > 1e-4)
    return np.asarray((weights > LEAST_WEIGHT) | alone)


def random_depths(rng: np.random.Generator, probes: int) -> Array:
    """Maps of distances with true borders."""
    mean = rng.uniform(0.3, 2.0, (probes, DEPTH_SIDE, DEPTH_SIDE))
    square = mean**2 + rng.uniform(0.02, 0.2, mean.shape)
    return with_borders(np.stack([mean, square], axis=-1).astype(np.float32))


def randomise(technique: Any, bake: SrpBake, rng: np.random.Generator) -> tuple[Array, Array]:
    """Random light and depths; both as they lie on the device."""
    radiance = rng.normal(size=(len(bake.probes), bake.coefficients, 3)).astype(np.float32)
    radiance[:, 0] += 2.0
    write_lambda(technique, radiance)
    maps = random_depths(rng, len(bake.probes))
    technique.device.write(technique.movers.light.depth, maps)
    return radiance, maps.astype(np.float64)


@dataclass(frozen=True)
class LitPoints:
    """Points anywhere, on the device, that the probes light.

    Attributes:
        position: (n, 3), m.
        normal: (n, 3).
        launch: lights them.
        light: (n, 3) irradiance, W/m2, once that has run.
    """

    position: Array
    normal: Array
    launch: Launch
    light: Buffer

    @staticmethod
    def at_random(
        technique: Any,
        rng: np.random.Generator,
        low: tuple[float, float, float],
        high: tuple[float, float, float],
        count: int = 500,
    ) -> LitPoints:
        """Points between two corners, of SRP set up on a device for things that move."""
        position = rng.uniform(low, high, (count, 3)).astype(np.float32)
        normal = random_unit(rng, count).astype(np.float32)
        device = technique.device
        light: Buffer = device.empty("point_light", (count, 3), np.float32)
        launch = technique.movers.light.receivers(
            technique._application,
            technique.variant.coefficients,
            device.upload("point_positions", position),
            device.upload("point_normals", normal),
            light,
        )
        return LitPoints(position.astype(np.float64), normal.astype(np.float64), launch, light)

    def expected(self, bake: SrpBake, maps: Array, radiance: Array) -> tuple[Array, Array, Array]:
        """Their light (n, 3), the weights (n,) of the probes in reach, and where single precision
        knows the light (n,); see :func:`probe_light` and :func:`probes_told`.
        """
        light, weights = probe_light(bake, maps, radiance, self.position, self.normal)
        return light, weights, probes_told(bake, self.position, weights)
