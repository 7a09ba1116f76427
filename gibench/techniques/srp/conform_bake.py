"""SRP's bake against float64 NumPy, for `gibench conform`."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from gibench.arrays import Array
from gibench.rays.embree import EmbreeTracer
from gibench.scene.model import Scene
from gibench.techniques.parts.conformance.case import Bench, Case, at_least, off
from gibench.techniques.parts.conformance.rooms import room
from gibench.techniques.srp.bake.data import ProbeSet
from gibench.techniques.srp.bake.settings import Interpolation, SrpBakeSettings
from gibench.techniques.srp.bake.sh import sh_basis
from gibench.techniques.srp.bake.transport import TransportBaker
from gibench.techniques.srp.bake.weights import nearby
from gibench.techniques.srp.conform_bake_oracle import brute_force, primary_rays

RECEIVERS, RAYS, RADIUS = 8, 77, 2.4
KERNELS = ("transport_rays", "transport_weights", "transport_accumulate")


def _baker(
    bench: Bench,
    rng: np.random.Generator,
    components: int = 1,
    interpolation: Interpolation = "srp",
) -> tuple[Scene, TransportBaker, Array]:
    """A small room with a block in it, its bake, and some of its receivers."""
    scene, lightmap = room(4, open_top=bool(rng.integers(2)))
    low, high = (-0.85, 0.15, -0.95), (0.85, 2.25, 0.95)
    probes = ProbeSet(rng.uniform(low, high, (5, 3)).astype(np.float32), RADIUS)
    chosen = SrpBakeSettings(
        sh_order=int(rng.integers(0, 5)),
        transport_rays=RAYS,
        receiver_order=int(components > 1),
        least_valid=0.0,
        visibility="exact",
        interpolation=interpolation,
    )
    baker = TransportBaker(
        scene,
        lightmap,
        probes,
        chosen,
        EmbreeTracer(scene.corners, threads=1),
        None,
        int(rng.integers(1000)),
        cl_device=bench.cl_device,
        kernel_root=bench.kernel_root,
    )
    receivers = np.sort(rng.choice(len(lightmap.receivers), RECEIVERS, replace=False))
    return scene, baker, receivers.astype(np.int32)


def _transport(
    bench: Bench, rng: np.random.Generator, size: int, components: int
) -> Iterator[float]:
    """Rays, which samples count and from which probes they are seen, and what they add up to."""
    scene, baker, receivers = _baker(bench, rng, components)
    worker, held = baker.worker(), baker.lightmap.receivers
    rows, sample = worker.rows(receivers), worker.primary_rays(receivers)
    origins, directions, certain = primary_rays(baker, receivers)
    yield at_least(float(certain.mean()), 0.9)
    yield off(sample.origins[certain], origins[certain], absolute=1e-5)
    yield off(sample.directions[certain], directions[certain], absolute=1e-5)
    probes, parts = len(baker.probes), baker.components
    got = np.zeros((RECEIVERS, parts, probes, baker.coefficients))
    got[:, :, rows.probes] = rows.matrix.reshape(RECEIVERS, parts, len(rows.probes), -1)
    compared = 0
    for i, receiver in enumerate(receivers):
        direct = brute_force(
            scene,
            baker.probes,
            held.position[receiver].astype(np.float64),
            sample.origins[i],
            sample.directions[i],
            baker.settings.order,
            held.normal[receiver].astype(np.float64) if components > 1 else None,
        )
        if direct is None:
            continue
        expected, valid = direct
        compared += 1
        yield off(np.array(rows.valid[i]), np.array(valid))
        expected = expected.reshape(parts, probes, -1)
        yield off(got[i], expected, absolute=1e-5 * max(float(np.abs(expected).max()), 1.0))
    yield at_least(compared / RECEIVERS, 0.25)


def _plain(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Blending in the receiver's own direction, all probes counting (Bennett 2019, eq. 4.3)."""
    _, baker, receivers = _baker(bench, rng, interpolation="spatial")
    worker, held = baker.worker(), baker.lightmap.receivers
    rows, sample = worker.rows(receivers), worker.primary_rays(receivers)
    got = np.zeros((RECEIVERS, len(baker.probes), baker.coefficients))
    got[:, rows.probes] = rows.matrix.reshape(RECEIVERS, len(rows.probes), -1)
    for i, receiver in enumerate(receivers):
        started = (sample.directions[i] ** 2).sum(axis=1) > 0.5
        near = nearby(held.position[receiver : receiver + 1], baker.probes)
        expected = np.zeros((len(baker.probes), baker.coefficients))
        if len(near.probe):
            mean = sh_basis(baker.settings.order, sample.directions[i][started]).mean(axis=0)
            weight = near.weight.astype(np.float64)
            expected[near.probe] = np.pi * (weight / weight.sum())[:, None] * mean
        yield off(np.array(rows.valid[i]), np.array(started.sum() if len(near.probe) else 0))
        yield off(got[i], expected, absolute=1e-5 * max(float(np.abs(expected).max()), 1.0))


def _case(name: str, components: int, *kernels: str) -> Case:
    named = tuple(f"srp/bake.cl:{kernel}" for kernel in (*KERNELS, *kernels))
    return Case(name, named, partial(_transport, components=components), (1,))


CASES = [
    _case("SRP's bake of transport", 1, "transport_decide"),
    _case("SRP's bake of transport in order 1", 4, "transport_decide", "transport_linear"),
    Case(
        "SRP's bake without mutual visibility",
        tuple(f"srp/bake.cl:{kernel}" for kernel in (*KERNELS, "transport_plain")),
        _plain,
        (1,),
    ),
]
