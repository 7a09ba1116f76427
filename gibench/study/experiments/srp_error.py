"""Where SRP's error comes from: its parts replaced, one at a time."""

from __future__ import annotations

import itertools
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from gibench.arrays import Doubles
from gibench.errors import GibenchError
from gibench.measure.session.session import Session
from gibench.report.plots import Axes, Series, plot
from gibench.resources import data
from gibench.scene.lightmap import Lightmap
from gibench.study.errors import errors_among
from gibench.study.experiments.common import Context, Experiment, Measuring, Point, markdown
from gibench.study.experiments.kept import Found, Kept
from gibench.study.experiments.side_by_side import trace_truth
from gibench.study.quality import group_of
from gibench.study.regions import WHOLE
from gibench.study.settle import settle
from gibench.study.srp_parts import REPLACEMENTS, Parts, baked_otherwise
from gibench.techniques.job import Job
from gibench.techniques.srp.technique import Srp
from gibench.work import Worker

# The real Sponza is given by its path (--scene).
_SCENES = ("cornell-box", "blue-orange-box", "hall")
_IMAGE = (96, 54)  # the figures are the receivers'
_RUN, _NOTHING, _PLACEMENT, _BOUNCES = "nothing, as it runs", "nothing", "placement", "bounces"
_FIGURES = ("bias", "rel_l2")


@dataclass(frozen=True)
class Own:
    """What ``scenes/srp-error/NAME.toml`` says of a scene.

    Attributes:
        receivers: to aim for.
        transport_rays: of the bake.
        probes: (p, 3) float32 set by hand; none where nobody did.
        regions: (low, high) corners of boxes by name, m.
    """

    receivers: int = 4000
    transport_rays: int = 1024
    probes: npt.NDArray[np.float32] | None = field(default=None, repr=False)
    regions: tuple[tuple[str, tuple[float, ...], tuple[float, ...]], ...] = ()

    @staticmethod
    def of(scene: str) -> Own:
        """That of the scene called ``scene``; the defaults where there is no file."""
        path = data("scenes") / "srp-error" / f"{scene}.toml"
        if not path.is_file():
            return Own()
        table = tomllib.loads(path.read_text("utf-8"))
        lattices = [_lattice(entry) for entry in table.get("probes", ())]
        probes = np.concatenate(lattices).astype(np.float32) if lattices else None
        regions = tuple(
            (entry["name"], tuple(entry["low"]), tuple(entry["high"]))
            for entry in table.get("region", ())
        )
        return Own(table["receivers"], table["transport_rays"], probes, regions)

    def masks(self, lightmap: Lightmap) -> dict[str, npt.NDArray[np.bool_]]:
        """(n,) receivers of each region, the whole first; one is in the first box that holds it."""
        position = lightmap.receivers.position
        found = {WHOLE: np.ones(len(position), np.bool_)}
        left = np.ones(len(position), np.bool_)
        for name, low, high in self.regions:
            inside = ((position >= low) & (position <= high)).all(axis=1) & left
            found[name], left = inside, left & ~inside
        return found


def _lattice(entry: dict[str, Any]) -> Doubles:
    """The points (p, 3) of a lattice from ``low`` to ``high``; one along an axis is at ``low``."""
    axes = [
        np.linspace(low, high, count)
        for low, high, count in zip(entry["low"], entry["high"], entry["count"], strict=True)
    ]
    return np.array(list(itertools.product(*axes)))


def _job(context: Context, scene: str, own: Own) -> Job:
    if context.quick:
        return context.srp(scene, context.profiles[0], receivers=300)
    probes, usual = own.probes, context.site.standing().scene(scene).probes.count
    return context.srp(
        scene,
        context.profiles[0],
        probes=None if probes is None or len(probes) == usual else len(probes),
        receivers=own.receivers,
        transport_rays=str(own.transport_rays),
    )


def _points(context: Context) -> Iterator[Point]:
    for name in context.scene_or(*_SCENES):
        scene = context.site.standing().scene(name).name
        own = Own.of(scene)
        by_hand = [] if own.probes is None else [_PLACEMENT]
        replaced = [_RUN, *by_hand, *REPLACEMENTS]
        for what in replaced:
            yield Point({"scene": scene, "replaced": what}, _job(context, name, own))


def _parts(context: Context, job: Job, truth: Doubles) -> Parts:
    """The parts of a job, of which what the receivers send out is the technique's own."""
    shared, settings = context.site.standing(), replace(job.settings, bounces=False)
    with Session.open(replace(job, settings=settings), shared, context.site.cl_device) as session:
        session.prepare(whole=True)
        session.frame(0)
        technique, world = session.technique, session.world
        assert isinstance(technique, Srp)
        sent = technique.outgoing_radiance().astype(np.float64)
    return Parts(
        scene=world.scene,
        lightmap=world.lightmap,
        settings=job.settings.bake_settings(),
        bake=world.baked,
        sent=sent,
        truth=truth,
        seed=context.site.seed,
        folder=shared.cache_dir,
    )


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    job = replace(unit.point.job, shot=context.shot(_IMAGE))
    replaced, options, site = unit.point.key["replaced"], context.quality(), context.site
    group = group_of(job, options, site)
    own = Own.of(unit.point.key["scene"])
    if replaced == _RUN:
        light = settle(job, options.settle, site.standing(), site.cl_device, worker).irradiance
    else:
        parts = site.kept(
            ("srp parts", job.scene, job.receivers, job.settings, options),
            lambda: _parts(context, job, group.truth.value),
        )
        if replaced == _PLACEMENT:
            if own.probes is None:
                raise GibenchError("nobody set probes by hand here")
            light = baked_otherwise(parts, own.probes)
        else:
            light = REPLACEMENTS[replaced](parts)
    if replaced == _BOUNCES:
        group = group_of(job, replace(options, bounces=1), site)
    rows = []
    for region, mask in own.masks(group.lightmap).items():
        found = errors_among(group.truth, light, mask & group.open)
        values = {name: found[name].value for name in _FIGURES}
        noises = {f"{name}_noise": found[name].noise for name in _FIGURES}
        rows.append(
            {"region": region, "receivers": int((mask & group.open).sum()), **values, **noises}
        )
    return Found(rows)


def explained(table: pd.DataFrame) -> pd.DataFrame:
    """The rows of ``table`` with what each replacement takes off bias and relative L2 error."""
    keys = ["scene", "region"]
    base = table[table["replaced"] == _NOTHING].set_index(keys)[list(_FIGURES)]
    found = table.join(base.rename(columns={name: f"{name}_base" for name in _FIGURES}), on=keys)
    for name in _FIGURES:
        found[f"{name}_explained"] = found.pop(f"{name}_base") - found[name]
    return found


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = explained(table[table["status"] == "ok"])
    axes = [
        Axes(
            f"{scene}, {region}",
            "part replaced",
            "relative L2 error, %",
            [Series("", list(range(len(rows))), (100 * rows["rel_l2"]).tolist())],
        )
        for (scene, region), rows in ok.groupby(["scene", "region"], sort=False)
    ]
    plot(kept.path / "srp-error", axes, "In the order of the table.")
    formats = {f"{name}{end}": ".2%" for name in _FIGURES for end in ("", "_explained")}
    shown = ["scene", "region", "replaced", "bias", "rel_l2", "bias_explained", "rel_l2_explained"]
    return "\n\n".join(
        (
            "*nothing*: SRP's steps on the host in float64; *as it runs*: on the device. Every "
            "other row replaces one part: compression by none; visibility tables by exact rays; "
            "light at relight hits by the true light; the map's direct light, that of the middle "
            "of each receiver, by that of the point hit; relight rays by sixteen times as many; "
            "the probes' band-limited radiance by what a receiver's rays meet (*unseen rays*: "
            "those whose end no probe sees among them); the sky inside probes by a receiver's own "
            "visibility of it; automatic placement by probes set by hand, or moved by what they do "
            "to the error; many bounces by one, held against the truth of one. *explained*: what "
            "of bias and relative L2 error goes away with it. Over receivers that lie in no other "
            "geometry, weighted by area.",
            markdown(ok[shown], formats),
            "![errors](srp-error.png)",
        )
    )


EXPERIMENT = Experiment(
    name="srp-error",
    title="Where the error of sparse radiance probes comes from",
    source="sections 3 to 5.2 of Silvennoinen and Lehtinen 2017, each of whose steps is replaced",
    profiles=("vega56",),
    keys=("scene", "replaced"),
    columns=("region", "receivers", *_FIGURES, *(f"{name}_noise" for name in _FIGURES)),
    points=_points,
    measure=_measure,
    present=_present,
    timed=False,
    truth=trace_truth,
)
