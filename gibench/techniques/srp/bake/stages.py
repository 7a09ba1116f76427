"""Baking SRP: probes, relight samples and compressed transport, through a resumable store."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from gibench.arrays import Ints
from gibench.bake.store import FORMAT_VERSION, Arrays, BakeStore
from gibench.progress import progress
from gibench.rays.embree import EmbreeTracer
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.srp.bake.cpca import aabb_clusters, compress
from gibench.techniques.srp.bake.data import Cluster, ProbeSet, RelightSamples, SrpBake
from gibench.techniques.srp.bake.expected_light import ExpectedLight, expected_light
from gibench.techniques.srp.bake.probes import mean_overlap, place_probes
from gibench.techniques.srp.bake.relight import relight_samples
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.transport import (
    Clock,
    TransportBaker,
    TransportWorker,
    surface_offset,
)
from gibench.techniques.srp.bake.visibility import visibility_tables


@dataclass
class BakeReport:
    """What a bake did.

    Attributes:
        units_baked: AABB leaves computed by this run.
        units_loaded: AABB leaves that were in the store.
        seconds: wall time of each stage.
        clock: time and counts of each part of the transport, summed over workers.
        stored_bytes: size of the store on disk.
    """

    units_baked: int = 0
    units_loaded: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
    clock: Clock = field(default_factory=Clock)
    stored_bytes: int = 0


def bake_key(scene: Scene, lightmap: Lightmap, settings: SrpBakeSettings, seed: int) -> str:
    """SHA-256 of everything the bake depends on."""
    given = scene.probes.positions
    digest = hashlib.sha256()
    for part in (
        f"srp {FORMAT_VERSION}",
        scene.geometry_hash(),
        lightmap.content_hash(),
        settings.key(),
        str(seed),
        str(scene.probes.count),
    ):
        digest.update(part.encode() + b"\0")
    if given is not None:
        digest.update(np.ascontiguousarray(given, np.float32).tobytes())
    return digest.hexdigest()


def bake_srp(
    scene: Scene,
    lightmap: Lightmap,
    settings: SrpBakeSettings,
    store_dir: Path,
    seed: int = 0,
    report: BakeReport | None = None,
) -> SrpBake:
    """All that SRP computes ahead of frames, from the store where it is there already.

    Each AABB leaf is computed, compressed and stored before its worker takes the next; what is in
    the store is not computed again. Interrupted, a rerun goes on from there.

    Args:
        scene: the scene.
        lightmap: its atlas.
        settings: of the bake.
        store_dir: folder of the stores; this bake's is named by its content key.
        seed: of every random choice.
        report: filled in with what was done, where one is given.

    Raises:
        BadInput: the scene has no place for the probes, or the store cannot be written.
        CannotRun: there is no OpenCL device, or the disk is full.
    """
    report = BakeReport() if report is None else report
    made_from = {"scene": scene.name, "receivers": len(lightmap.receivers)}
    made_from |= {"settings": settings.key(), "seed": seed}
    store = BakeStore(store_dir, bake_key(scene, lightmap, settings, seed), made_from)
    with store.locked():
        tracer = EmbreeTracer(scene.corners)
        start = perf_counter()
        probes = _probes(store, scene, lightmap, settings, tracer, seed)
        report.seconds["probes"] = -(start - (start := perf_counter()))
        relight = _relight(store, scene, lightmap, settings, probes, tracer, seed)
        report.seconds["relight"] = -(start - (start := perf_counter()))
        members = aabb_clusters(lightmap.receivers.position, settings.cluster_size)
        found = {i: _load_unit(store, i, members[i]) for i in range(len(members))}
        missing = [i for i, unit in found.items() if unit is None]
        report.units_loaded = len(members) - len(missing)
        report.units_baked = len(missing)
        if missing:
            offset = surface_offset(scene)
            tables = None
            if settings.visibility == "cached":
                tables = visibility_tables(scene, lightmap, probes, tracer, offset, seed)
            report.seconds["visibility tables"] = -(start - (start := perf_counter()))
            baker = TransportBaker(scene, lightmap, probes, settings, tracer, tables, seed)
            light = expected_light(lightmap, relight)
            for i, baked in _bake_units(baker, light, store, members, missing, report.clock):
                found[i] = baked
            report.seconds["transport"] = -(start - (start := perf_counter()))
        report.stored_bytes = store.nbytes()
    units = [unit for i in range(len(members)) if (unit := found[i]) is not None]
    usable = sum(unit.usable for unit in units)
    return SrpBake(
        settings.sh_order,
        probes,
        relight,
        tuple(cluster for unit in units for cluster in unit.clusters),
        usable / max(1, len(lightmap.receivers)),
        mean_overlap(probes, lightmap.receivers.position),
    )


@dataclass(frozen=True)
class Unit:
    """One unit of work: the clusters of one AABB leaf.

    Attributes:
        clusters: the leaf as one cluster, or refined.
        usable: receivers with at least one valid sample.
    """

    clusters: tuple[Cluster, ...]
    usable: int


def _probes(
    store: BakeStore,
    scene: Scene,
    lightmap: Lightmap,
    settings: SrpBakeSettings,
    tracer: EmbreeTracer,
    seed: int,
) -> ProbeSet:
    if (stored := store.load("probes")) is not None:
        return ProbeSet(stored["positions"], float(stored["radius"]))
    probes = place_probes(
        scene, lightmap, tracer, settings.probes, settings.overlap, surface_offset(scene), seed
    )
    store.save(
        "probes", {"positions": probes.positions, "radius": np.asarray(probes.radius, np.float64)}
    )
    return probes


def _relight(
    store: BakeStore,
    scene: Scene,
    lightmap: Lightmap,
    settings: SrpBakeSettings,
    probes: ProbeSet,
    tracer: EmbreeTracer,
    seed: int,
) -> RelightSamples:
    if (stored := store.load("relight")) is not None:
        return RelightSamples(stored["directions"], stored["basis"], stored["texel"])
    order, count = settings.sh_order, settings.relight_samples
    samples = relight_samples(scene, lightmap, probes, tracer, order, count, seed)
    arrays = {name: getattr(samples, name) for name in ("directions", "basis", "texel")}
    store.save("relight", arrays)
    return samples


def _name(index: int) -> str:
    return f"cluster-{index:05d}"


def _load_unit(store: BakeStore, index: int, members: Ints) -> Unit | None:
    stored = store.load(_name(index))
    if stored is None:
        return None
    clusters = tuple(_cluster(stored, part) for part in range(int(stored["parts"])))
    held = np.sort(np.concatenate([c.receivers for c in clusters]))
    if not np.array_equal(held, members):
        return None
    return Unit(clusters, int(stored["usable"]))


_CLUSTER_ARRAYS = ("receivers", "probes", "projection", "reconstruction", "error")


def _cluster(stored: Arrays, part: int) -> Cluster:
    receivers, probes, projection, reconstruction, error = (
        stored[f"{name}-{part}"] for name in _CLUSTER_ARRAYS
    )
    return Cluster(receivers, probes, projection, reconstruction, float(error))


def _bake_unit(
    worker: TransportWorker, light: ExpectedLight, store: BakeStore, index: int, members: Ints
) -> Unit:
    """Compute, compress, store."""
    receivers, settings = worker.baker.lightmap.receivers, worker.baker.settings
    rows = worker.rows(members)
    start = perf_counter()
    clusters = compress(
        members,
        receivers.position[members],
        receivers.normal[members],
        rows.probes,
        rows.matrix,
        light.columns(rows.probes),
        settings.svd_vectors,
        settings.svd_threshold,
    )
    start = worker.clock.add("compress", start, len(members))
    usable = int((rows.valid > 0).sum())
    arrays = {"parts": np.asarray(len(clusters)), "usable": np.asarray(usable)}
    for part, cluster in enumerate(clusters):
        arrays |= {f"{n}-{part}": np.asarray(getattr(cluster, n)) for n in _CLUSTER_ARRAYS}
    store.save(_name(index), arrays)
    worker.clock.add("store", start, 1)
    return Unit(tuple(clusters), usable)


def _bake_units(
    baker: TransportBaker,
    light: ExpectedLight,
    store: BakeStore,
    members: list[Ints],
    missing: list[int],
    clock: Clock,
) -> Iterator[tuple[int, Unit]]:
    """Bake the ``missing`` leaves, as many at once as there are workers."""
    count = max(1, min(baker.settings.workers or os.cpu_count() or 1, len(missing)))
    idle: SimpleQueue[TransportWorker] = SimpleQueue()
    workers = [baker.worker() for _ in range(count)]
    for worker in workers:
        idle.put(worker)

    def bake(index: int) -> tuple[int, Unit]:
        worker = idle.get()
        try:
            return index, _bake_unit(worker, light, store, index, members[index])
        finally:
            idle.put(worker)

    receivers = sum(len(members[i]) for i in missing)
    # BLAS threads of one worker would only take the cores of the others.
    with (
        threadpool_limits(limits=1 if count > 1 else None),
        progress("Baking transport", receivers) as advance,
        ThreadPoolExecutor(count) as pool,
    ):
        waiting = iter(missing)
        running: set[Future[tuple[int, Unit]]] = set()
        while True:
            while len(running) < count and (index := next(waiting, None)) is not None:
                running.add(pool.submit(bake, index))
            if not running:
                break
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                index, unit = future.result()
                advance(len(members[index]))
                yield index, unit
    for worker in workers:
        for part, seconds in worker.clock.seconds.items():
            clock.seconds[part] = clock.seconds.get(part, 0.0) + seconds
            clock.counts[part] = clock.counts.get(part, 0) + worker.clock.counts[part]
