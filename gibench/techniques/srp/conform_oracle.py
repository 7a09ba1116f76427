"""What SRP's kernels are held against: float64 NumPy on random baked data."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.parts.conformance.synthetic import random_unit
from gibench.techniques.srp.bake.data import Cluster, ProbeSet, RelightSamples, SrpBake
from gibench.techniques.srp.bake.sh import sh_basis
from gibench.techniques.srp.storage import store_cluster, stored_values

Array = npt.NDArray[Any]


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
