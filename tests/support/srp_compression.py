r"""Compressed against uncompressed irradiance of a scene, under random lightings.

    PYTHONPATH=. python tests/support/srp_compression.py sponza.obj --receivers 246325 \
        --probes 150 --suns 15 --lights 30 --leaves 36

bakes the transport of so many random leaves of the AABB tree (all, without ``--leaves``) and prints
the relative L2 error of each lighting over all their receivers, and the stored size scaled to the
scene. A lighting is one point light or one sun, direct light only: without bounces and sky light,
which are smooth, there is nothing to hide errors under. Two more are no light that exists: probe
radiance of random coefficients.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gibench.bake.lightmap import cached_lightmap
from gibench.rays.embree import EmbreeTracer
from gibench.rays.offset import surface_offset
from gibench.scene.load import load_scene
from gibench.techniques.srp.bake.cpca import aabb_clusters, compress
from gibench.techniques.srp.bake.data import SrpBake
from gibench.techniques.srp.bake.expected_light import expected_light
from gibench.techniques.srp.bake.probes import place_probes
from gibench.techniques.srp.bake.relight import relight_samples
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.transport import TransportBaker
from gibench.techniques.srp.bake.visibility import visibility_tables
from gibench.techniques.srp.storage import store_cluster, stored_values
from support.lightings import point_light, probe_radiance, sun

RANDOM = 2
"""Lightings of random coefficients."""


@dataclass
class Found:
    """What was measured.

    Attributes:
        errors: (lights,) relative L2 error of the irradiance, by lighting.
        random: (RANDOM,) that under random coefficients.
        leaves, of_leaves: leaves baked, and those of the scene.
        clusters, vectors: of the leaves baked; vectors of each.
        coefficients: reconstruction coefficients per receiver.
        nbytes: of both matrices in 16 bits, scaled to the scene's receivers.
    """

    errors: np.ndarray
    random: np.ndarray
    leaves: int
    of_leaves: int
    clusters: int
    vectors: np.ndarray
    coefficients: float
    nbytes: float


def measure(
    scene_name: str,
    receivers: int,
    settings: SrpBakeSettings,
    leaves: int | None = None,
    suns: int = 0,
    storage: str = "fp16",
    cache: Path | None = None,
    seed: int = 0,
    count: int = 10,
) -> Found:
    """Bake leaves of a scene and compare."""
    scene = load_scene(scene_name)
    with tempfile.TemporaryDirectory() as scratch:
        lightmap = cached_lightmap(scene, receivers, cache or Path(scratch))
    tracer, lift = EmbreeTracer(scene.corners), surface_offset(scene)
    probes = place_probes(scene, lightmap, tracer, settings.probes, settings.overlap, lift, 0)
    relight = relight_samples(
        scene, lightmap, probes, tracer, settings.order, settings.relight_samples
    )
    rng = np.random.default_rng(seed)
    lights = [sun(lightmap, tracer, rng, 5 * lift) for _ in range(suns)]
    lights += [point_light(scene, lightmap, tracer, rng, 5 * lift) for _ in range(count - suns)]
    radiance = probe_radiance(lightmap, relight, np.stack(lights, axis=1))
    noise = rng.standard_normal((*radiance.shape[:2], RANDOM))
    radiance = np.concatenate([radiance, noise], axis=2)
    tables = visibility_tables(scene, lightmap, probes, tracer, lift)
    worker = TransportBaker(scene, lightmap, probes, settings, tracer, tables).worker()
    light = expected_light(lightmap, relight)
    position, normal = lightmap.receivers.position, lightmap.receivers.normal
    members = aabb_clusters(position, settings.cluster_size)
    picked = np.arange(len(members))
    if leaves is not None and leaves < len(members):
        picked = np.sort(rng.choice(picked, leaves, replace=False))
    difference, total = np.zeros(count + RANDOM), np.zeros(count + RANDOM)
    clusters, sampled = [], 0
    for leaf in picked:
        own = members[leaf]
        rows = worker.rows(own)
        exact = rows.matrix.astype(np.float64) @ radiance[rows.probes].reshape(-1, count + RANDOM)
        parts = compress(
            own, position[own], normal[own], rows.probes, rows.matrix,
            light.columns(rows.probes), settings.svd_vectors, settings.svd_threshold,
        )  # fmt: skip
        for part in parts:
            stored = store_cluster(part, storage)
            basis = stored_values(stored.projection, storage) @ radiance[part.probes].reshape(
                len(part.probes) * radiance.shape[1], count + RANDOM
            )
            basis *= stored.scale[:, None]
            there = exact[np.searchsorted(own, part.receivers)]
            found = stored_values(stored.reconstruction, storage) @ basis
            difference += np.square(found - there).sum(axis=0)
        total += np.square(exact).sum(axis=0)
        clusters += parts
        sampled += len(own)
    bake = SrpBake(settings.order, probes, relight, tuple(clusters), 1.0, 1.0)
    errors = np.sqrt(difference / total)
    return Found(
        errors[:count],
        errors[count:],
        len(picked),
        len(members),
        len(clusters),
        np.array([len(c.projection) for c in clusters]),
        sum(c.reconstruction.size for c in clusters) / sampled,
        bake.transport_bytes(2) * len(position) / sampled,
    )


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scene")
    parser.add_argument("--receivers", type=int, required=True)
    parser.add_argument("--probes", type=int)
    parser.add_argument("--leaves", type=int)
    parser.add_argument("--lights", type=int, default=10)
    parser.add_argument("--suns", type=int, default=0, help="of the lights")
    parser.add_argument("--rays", type=int, default=4096)
    parser.add_argument("--threshold", type=float, default=SrpBakeSettings.svd_threshold)
    parser.add_argument("--storage", default="fp16")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cache", type=Path, help="folder that keeps the lightmap")
    given = parser.parse_args()
    settings = SrpBakeSettings(
        probes=given.probes, transport_rays=given.rays, svd_threshold=given.threshold
    )
    found = measure(
        given.scene, given.receivers, settings, given.leaves, given.suns, given.storage,
        given.cache, given.seed, given.lights,
    )  # fmt: skip
    percent, random = (
        " ".join(f"{100 * error:.2f}" for error in errors)
        for errors in (found.errors, found.random)
    )
    print(f"{given.scene}: {found.leaves} of {found.of_leaves} leaves, {given.storage}")
    print(f"  relative L2 error of {given.lights} lightings, %: {percent}")
    print(f"  of random coefficients, %: {random}")
    print(
        f"  {found.clusters} clusters, {(found.vectors == 32).mean():.0%} of them of 32 vectors; "
        f"{found.coefficients:.1f} coefficients a receiver; {found.nbytes / 1e6:.1f} MB"
    )


if __name__ == "__main__":
    main()
