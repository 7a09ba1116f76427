"""The stages of SRP's bake: probes, relight samples, visibility tables, compressed transport.

Transport is made of units, one for each leaf of the receivers' AABB tree: its rows are computed,
compressed and stored before a worker takes the next. A bake of a lower SH order is one stage more,
made from the transport of the highest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gibench.arrays import Ints
from gibench.bake.stage import Arrays, Format, Keep, Stage, Unit, stage_key
from gibench.rays.embree import scene_tracer
from gibench.rays.offset import surface_offset
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.srp.bake.cpca import aabb_clusters, compress
from gibench.techniques.srp.bake.data import Cluster, ProbeSet, RelightSamples, SrpBake, sh_count
from gibench.techniques.srp.bake.expected_light import expected_light
from gibench.techniques.srp.bake.lower_order import lower_clusters
from gibench.techniques.srp.bake.placement_stages import placement_stages
from gibench.techniques.srp.bake.probes import mean_overlap, place_probes
from gibench.techniques.srp.bake.relight import relight_samples
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.sky import sky_apart, tables_with_sky, with_sky
from gibench.techniques.srp.bake.transport import CHUNK_RAYS, TransportBaker
from gibench.techniques.srp.bake.visibility import VisibilityTables, visibility_tables
from gibench.work import Worker

# Raised whenever what a stage computes, or how it is stored, changes.
PROBES_VERSION = RELIGHT_VERSION = VISIBILITY_VERSION = TRANSPORT_VERSION = LOWER_VERSION = 4


@dataclass(frozen=True)
class Given:
    """What every stage is computed from.

    Attributes:
        scene: the scene.
        lightmap: its atlas.
        settings: of the bake.
        seed: of every random choice.
        chunk_rays: primary rays that a worker traces at once; no result depends on it.
    """

    scene: Scene
    lightmap: Lightmap
    settings: SrpBakeSettings
    seed: int = 0
    chunk_rays: int = CHUNK_RAYS


@dataclass(frozen=True)
class Leaf:
    """The clusters of one leaf of the AABB tree.

    Attributes:
        clusters: the leaf as one cluster, or refined.
        usable: receivers with at least one valid sample.
    """

    clusters: tuple[Cluster, ...]
    usable: int


def srp_stages(given: Given, order: int | None = None) -> tuple[Stage, ...]:
    """The stages of a bake; the last one's value is the :class:`SrpBake`.

    Args:
        given: what it is computed from.
        order: a lower SH order than the settings' that it is lowered to once it is baked.

    Raises:
        ValueError: ``order`` is higher than the settings'.
    """
    *placing, relight, visibility, transport = _highest(given)
    probes = placing[-1]
    leaves, lowered = transport, tuple[Stage, ...]()
    if order is not None and order != given.settings.order:
        if order > given.settings.order:
            raise ValueError(f"order {order} cannot be had from order {given.settings.order}")
        leaves = _lowered(given, transport, order)
        lowered = (leaves,)
    order = given.settings.order if order is None else order
    needs = (probes, relight, leaves)
    whole = Stage(
        name="srp-bake",
        key=stage_key("srp-bake", 0, needs=needs),
        compute=_assemble,
        given=(given, order),
        needs=needs,
        keep=Keep.NEVER,
    )
    return *placing, relight, visibility, transport, *lowered, whole


def _highest(given: Given) -> tuple[Stage, ...]:
    """Stages that place the probes, the last of which gives them; relight samples, visibility
    tables and transport at the settings' SH order.
    """
    scene, lightmap, settings = given.scene, given.lightmap, given.settings
    own = scene.probes.count, scene.probes.positions
    probes = Stage(
        name="srp-probes",
        key=stage_key(
            "srp-probes",
            PROBES_VERSION,
            scene.geometry_hash(),
            lightmap.content_hash(),
            settings.placed_by,
            given.seed,
            own[0],
            "none" if own[1] is None else np.asarray(own[1], np.float32),
        ),
        compute=_probes,
        given=given,
        format=Format(_write_probes, _read_probes),
        made_from=_made_from(given, probes=settings.probes, overlap=settings.overlap),
    )
    placing: tuple[Stage, ...] = (probes,)
    if settings.placement == "error":
        more = placement_stages(
            scene, lightmap, settings, given.seed, probes, Format(_write_probes, _read_probes)
        )
        placing = (*placing, *more)
        probes = placing[-1]
    order, samples = settings.order, settings.relight_samples
    relight = Stage(
        name="srp-relight",
        key=stage_key("srp-relight", RELIGHT_VERSION, order, samples, needs=(probes,)),
        compute=_relight,
        given=given,
        needs=(probes,),
        format=Format(_write_relight, _read_relight),
        made_from=_made_from(given, sh_order=order, relight_samples=samples),
    )
    visibility = Stage(
        name="srp-visibility",
        key=stage_key("srp-visibility", VISIBILITY_VERSION, needs=(probes,)),
        compute=_visibility,
        given=given,
        needs=(probes,),
        format=Format(_write_tables, _read_tables),
        keep=Keep.WHILE_NEEDED,
        made_from=_made_from(given),
    )
    needs = (probes, relight, *((visibility,) if settings.visibility == "cached" else ()))
    # Rows count, not receivers: what compression takes grows with the cube of them.
    most = max(1, settings.cluster_size // settings.components)
    members = aabb_clusters(lightmap.receivers.position, most)
    transport = Stage(
        name="srp-transport",
        key=stage_key("srp-transport", TRANSPORT_VERSION, settings.everything, needs=needs),
        compute=_transport,
        given=given,
        needs=needs,
        units=tuple(
            Unit(f"cluster-{index:05d}", index, own, len(own)) for index, own in enumerate(members)
        ),
        format=Format(_write_leaf, _read_leaf),
        title="Baking transport",
        made_from=_made_from(given, settings=repr(settings)),
    )
    return *placing, relight, visibility, transport


def _lowered(given: Given, transport: Stage, order: int) -> Stage:
    """The transport of a lower SH order."""
    assert transport.units is not None
    settings = replace(given.settings, sh_order=order)
    return Stage(
        name="srp-lowered",
        key=stage_key("srp-lowered", LOWER_VERSION, order, needs=(transport,)),
        compute=_lower,
        given=(given.settings, order),
        needs=(transport,),
        units=tuple(replace(u, name=f"lowered-{u.index:05d}", size=1) for u in transport.units),
        format=Format(_write_leaf, _read_leaf),
        title=f"Lowering the bake to order {order}",
        made_from=_made_from(given, settings=repr(settings)),
    )


def _made_from(given: Given, **more: Any) -> tuple[tuple[str, Any], ...]:
    of = {"scene": given.scene.name, "receivers": len(given.lightmap.receivers)}
    return tuple({**of, "seed": given.seed, **more}.items())


# What the stages compute


def _probes(given: Given, needed: Sequence[Any], unit: Unit, worker: Worker) -> ProbeSet:
    settings = given.settings
    return place_probes(
        given.scene,
        given.lightmap,
        scene_tracer(given.scene),
        count=settings.probes,
        overlap=settings.overlap,
        offset=surface_offset(given.scene),
        seed=given.seed,
    )


def _relight(given: Given, needed: Sequence[Any], unit: Unit, worker: Worker) -> RelightSamples:
    (probes,) = needed
    return relight_samples(
        given.scene,
        given.lightmap,
        probes,
        scene_tracer(given.scene),
        sh_order=given.settings.order,
        count=given.settings.relight_samples,
        seed=given.seed,
    )


def _visibility(
    given: Given, needed: Sequence[Any], unit: Unit, worker: Worker
) -> VisibilityTables:
    (probes,) = needed
    return visibility_tables(
        given.scene,
        given.lightmap,
        probes,
        scene_tracer(given.scene),
        offset=surface_offset(given.scene),
        seed=given.seed,
    )


def _transport(given: Given, needed: Sequence[Any], unit: Unit, worker: Worker) -> Leaf:
    """Rows of one leaf's receivers, compressed."""
    probes, relight, tables = (*needed, None)[:3]
    lightmap, settings, members = given.lightmap, given.settings, unit.data

    apart = settings.sky == "receivers"
    if apart:
        relight = sky_apart(relight)

    def make() -> TransportBaker:
        return TransportBaker(
            given.scene,
            lightmap,
            with_sky(probes) if apart else probes,
            settings,
            scene_tracer(given.scene),
            tables_with_sky(tables) if apart and tables is not None else tables,
            seed=given.seed,
            chunk_rays=given.chunk_rays,
        )

    baker = worker.shared("transport", make)
    light = worker.shared("expected light", lambda: expected_light(lightmap, relight))
    rows = worker.own("transport", baker.worker).rows(members)
    clusters = compress(
        members,
        positions=lightmap.receivers.position[members],
        normals=lightmap.receivers.normal[members],
        probes=rows.probes,
        matrix=rows.matrix,
        light=light.columns(rows.probes),
        most=settings.svd_vectors,
        threshold=settings.svd_threshold,
        components=settings.components,
    )
    return Leaf(tuple(clusters), int((rows.valid > 0).sum()))


def _lower(
    given: tuple[SrpBakeSettings, int], needed: Sequence[Any], unit: Unit, worker: Worker
) -> Leaf:
    settings, order = given
    leaf: Leaf = needed[0][unit.index]
    lowered = lower_clusters(
        leaf.clusters,
        before=settings.order,
        order=order,
        most=settings.svd_vectors,
        threshold=settings.svd_threshold,
    )
    return replace(leaf, clusters=tuple(lowered))


def _assemble(
    given: tuple[Given, int], needed: Sequence[Any], unit: Unit, worker: Worker
) -> SrpBake:
    (of, order), (probes, relight, leaves) = given, needed
    receivers = of.lightmap.receivers
    basis = np.ascontiguousarray(relight.basis[:, : sh_count(order)])
    apart = of.settings.sky == "receivers"
    if apart:
        relight = sky_apart(relight)
    return SrpBake(
        sh_order=order,
        probes=with_sky(probes) if apart else probes,
        relight=replace(relight, basis=basis),
        clusters=tuple(cluster for leaf in leaves for cluster in leaf.clusters),
        usable_share=sum(leaf.usable for leaf in leaves) / max(1, len(receivers)),
        overlap=mean_overlap(probes, receivers.position),
        receiver_order=of.settings.receiver_order,
    )


# How it is stored


def _write_probes(probes: ProbeSet) -> Arrays:
    return {"positions": probes.positions, "radius": np.asarray(probes.radius, np.float64)}


def _read_probes(unit: Unit, stored: Arrays) -> ProbeSet:
    return ProbeSet(stored["positions"], float(stored["radius"]))


def _write_relight(relight: RelightSamples) -> Arrays:
    return {name: getattr(relight, name) for name in ("directions", "basis", "texel")}


def _read_relight(unit: Unit, stored: Arrays) -> RelightSamples:
    return RelightSamples(stored["directions"], stored["basis"], stored["texel"])


def _write_tables(tables: VisibilityTables) -> Arrays:
    return {"grid": np.asarray(tables.grid), "states": tables.states}


def _read_tables(unit: Unit, stored: Arrays) -> VisibilityTables:
    return VisibilityTables(int(stored["grid"]), stored["states"])


_CLUSTER_ARRAYS = ("receivers", "probes", "projection", "reconstruction", "error")


def _write_leaf(leaf: Leaf) -> Arrays:
    arrays = {"parts": np.asarray(len(leaf.clusters)), "usable": np.asarray(leaf.usable)}
    for part, cluster in enumerate(leaf.clusters):
        arrays |= {f"{n}-{part}": np.asarray(getattr(cluster, n)) for n in _CLUSTER_ARRAYS}
    return arrays


def _read_leaf(unit: Unit, stored: Arrays) -> Leaf | None:
    """None where the clusters hold other receivers than the unit's."""
    members: Ints = unit.data
    clusters = tuple(_read_cluster(stored, part) for part in range(int(stored["parts"])))
    held = np.sort(np.concatenate([cluster.receivers for cluster in clusters]))
    if not np.array_equal(held, members):
        return None
    return Leaf(clusters, int(stored["usable"]))


def _read_cluster(stored: Arrays, part: int) -> Cluster:
    receivers, probes, projection, reconstruction, error = (
        stored[f"{name}-{part}"] for name in _CLUSTER_ARRAYS
    )
    return Cluster(receivers, probes, projection, reconstruction, float(error))
