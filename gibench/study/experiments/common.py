"""What the papers' experiments share: their context, their points, tables and frame times."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import pandas as pd

from gibench.arrays import Doubles
from gibench.measure.plan.grid import grid
from gibench.measure.plan.stopping import Patience
from gibench.measure.session.rest import warm_up
from gibench.measure.session.session import Session
from gibench.measure.statistics.summary import summarize
from gibench.profiles import DeviceProfile
from gibench.study.experiments.kept import Found, Kept, Summarize
from gibench.study.experiments.taken import Taken
from gibench.study.quality_rows import QualityOptions
from gibench.study.settle import SettleOptions
from gibench.study.site import Site
from gibench.techniques.job import Job, Shot
from gibench.techniques.registry import find_technique
from gibench.work import Worker

TIMES = ("time_ms", "p95_ms", "frames", "memory_bytes")
RESTS = ("rest", "frames_to_rest", "ms_to_rest")


@dataclass(frozen=True)
class Context:
    """Where and how an experiment runs: plain data.

    Attributes:
        profiles: whose limits bind.
        site: where its points run.
        scenes: the user's, instead of the experiment's own; empty for these.
        quick: small sizes, to see that it works; figures of no meaning.
        frames: timed per point.
        patience: how long a technique is waited for until it is at rest, before it is timed.
        resolution: of the camera image instead of the experiment's own, or None.
        target_error: of references.
        reference_paths: of references at most; None for as many as the target error takes.
        target: what is to be the same, where an experiment has that; None for its own.
        taken: errors of an earlier run, which are not measured again.
    """

    profiles: tuple[DeviceProfile, ...]
    site: Site
    scenes: tuple[str, ...] = ()
    quick: bool = False
    frames: int = 30
    patience: Patience = field(default_factory=Patience)
    resolution: tuple[int, int] | None = None
    target_error: float = 0.02
    reference_paths: int | None = None
    target: float | None = None
    taken: Taken | None = None

    @property
    def transport(self) -> dict[str, str]:
        """Settings of SRP's bake: the published number of rays, or few where it is to be quick."""
        return {"transport_rays": "64", "relight_samples": "128"} if self.quick else {}

    @property
    def waits(self) -> Patience:
        """How long a technique is waited for; not at all where it is to be quick."""
        return Patience(frames=0) if self.quick else self.patience

    def shot(self, own: tuple[int, int]) -> Shot:
        """Image and camera; ``own`` is the experiment's image size, pixels."""
        width, height = (96, 54) if self.quick else self.resolution or own
        return Shot(width, height)

    def scene_or(self, *own: str) -> tuple[str, ...]:
        """The user's scenes, or the experiment's own; one of these where it is to be quick."""
        return self.scenes or (own[:1] if self.quick else own)

    def quality(self) -> QualityOptions:
        """How results are compared with the truth."""
        target = max(self.target_error, 0.2) if self.quick else self.target_error
        return QualityOptions(
            SettleOptions(32 if self.quick else 512),
            target_error=target,
            reference_paths=self.reference_paths,
        )

    def srp(
        self,
        scene: str,
        profile: DeviceProfile,
        *,
        sh_order: int = 7,
        probes: int | None = None,
        receivers: int | None = None,
        **settings: str,
    ) -> Job:
        """SRP with these settings."""
        return self.of(
            "srp",
            scene,
            profile,
            receivers,
            sh_order=sh_order,
            probes=probes,
            **{**self.transport, **settings},
        )

    def of(
        self,
        technique: str,
        scene: str,
        profile: DeviceProfile,
        receivers: int | None = None,
        **settings: Any,
    ) -> Job:
        """``technique`` with these settings, typed or as on the command line."""
        (job,) = grid(
            [profile],
            [find_technique(technique)],
            scenes=(scene,),
            receivers=() if receivers is None else (receivers,),
            settings={technique: {name: (value,) for name, value in settings.items()}},
            seed=self.site.seed,
        )
        return job

    def direct(self, scene: str, profile: DeviceProfile, receivers: int | None = None) -> Job:
        """Direct light only."""
        return self.of("direct", scene, profile, receivers)


@dataclass(frozen=True)
class Point:
    """One thing to measure: plain data.

    Attributes:
        key: values of the experiment's key columns.
        job: what is run for it.
        needs: labels of arrays that other points give, and without which it is still measured.
    """

    key: Mapping[str, Any]
    job: Job
    needs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Measuring:
    """A point with what it needs of others: a unit of work.

    Attributes:
        point: the point.
        needed: arrays by label, those that are there.
        timed: whether the experiment is about times.
    """

    point: Point
    needed: Mapping[str, Doubles] = field(default_factory=dict)
    timed: bool = True

    @property
    def name(self) -> str:
        """In messages."""
        return ", ".join(str(value) for value in self.point.key.values())


@dataclass(frozen=True)
class Experiment:
    """One of the papers' experiments.

    Attributes:
        name: on the command line.
        title: what it shows.
        source: figure or section and paper.
        profiles: that bind unless the user says otherwise.
        keys: columns that name a point.
        columns: the others, ``status`` and ``reason`` left out.
        points: what is measured, in order.
        measure: measures a point, and writes nothing.
        present: writes plots and pictures and returns the report's Markdown.
        samples: columns of its samples beside the keys, where it has any; its rows are then what
            ``summarize`` makes of them.
        summarize: the rows of a key, from all samples that are stored.
        timed: whether its times mean anything; where not, its points may be measured beside others,
            and times are left blank then.
        truth: traces what a point's job is compared with, ahead of points that are sent elsewhere,
            and tells its key in the store.
        target: what ``--target`` is of; empty where it has none.
        errors: columns that ``--errors-from`` takes from an earlier run.
    """

    name: str
    title: str
    source: str
    profiles: tuple[str, ...]
    keys: tuple[str, ...]
    columns: tuple[str, ...]
    points: Callable[[Context], Iterable[Point]] = field(repr=False)
    measure: Callable[[Context, Measuring, Worker], Found] = field(repr=False)
    present: Callable[[Context, Kept, pd.DataFrame], str] = field(repr=False)
    samples: tuple[str, ...] = ()
    summarize: Summarize | None = field(default=None, repr=False)
    timed: bool = True
    truth: Callable[[Context, Job], str] | None = field(default=None, repr=False)
    target: str = ""
    errors: tuple[str, ...] = ()


def markdown(table: pd.DataFrame, formats: Mapping[str, str] | None = None) -> str:
    """A table as Markdown; ``formats`` by column, blank where there is no value."""

    def cell(name: str, value: Any) -> str:
        if pd.isna(value):
            return ""
        given = (formats or {}).get(name)
        if given is None:
            given = ".4g" if isinstance(value, float) and not float(value).is_integer() else ""
            value = int(value) if isinstance(value, float) and not given else value
        return format(value, given).replace("|", "\\|")

    head = [str(name) for name in table.columns]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in table.to_dict("records"):
        lines.append("| " + " | ".join(cell(str(n), v) for n, v in row.items()) + " |")
    return "\n".join(lines)


def published(name: str) -> pd.DataFrame:
    """One of the papers' tables (``results/published/NAME.csv``)."""
    from gibench.resources import data

    with (data("published") / f"{name}.csv").open(encoding="utf-8") as file:
        return pd.read_csv(file)


def published_section(table: pd.DataFrame) -> str:
    """The papers' own figures, apart from ours."""
    if table.empty:
        return "The papers print no figures for this (their plots carry none)."
    return (
        "## Published\n\nTheirs, on their devices; not to be mixed with the table above.\n\n"
        + markdown(table)
    )


def timed(context: Context, job: Job, worker: Worker, own: tuple[int, int]) -> dict[str, Any]:
    """The frame times of ``job`` with lights moving as in a run, once it is at rest or has been
    waited for, and its memory.

    Raises:
        CannotRun: the profile or budget forbids it.
        GibenchError: a pass failed.
    """
    job = replace(job, shot=context.shot(own))
    site = context.site
    with Session.open(job, site.moving(), site.cl_device) as session:
        session.prepare(whole=True)
        session.compile()
        warmup, count = (1, 3) if context.quick else (5, context.frames)
        with worker.alone():
            rest = warm_up(session, warmup, context.waits)
            times = [session.frame(rest.frames + number).wall_ms for number in range(count)]
        summary = summarize(times)
        return {
            "time_ms": summary.median_ms,
            "p95_ms": summary.p95_ms,
            "frames": summary.count,
            "memory_bytes": session.memory_bytes,
            "rest": rest.in_words(),
            "frames_to_rest": rest.frames_to_rest,
            "ms_to_rest": rest.ms_to_rest,
            "reason": rest.warning(),
        }
