"""The rows of ``quality.csv``: what results are held against, by what rules, and what comes out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from gibench.arrays import Bools, Doubles
from gibench.device import SIMT
from gibench.errors import CannotRun, GibenchError
from gibench.measure.machine.environment import without_paths
from gibench.measure.runfolder.axes import Axis
from gibench.measure.runfolder.results import FAILED, OK, SKIPPED
from gibench.measure.statistics import faults
from gibench.measure.statistics.blotches import blotches
from gibench.reference.metrics import Measure
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.study.errors import METRICS, Truth, errors, errors_among
from gibench.study.flat import FlatChart, flat_charts, flat_errors
from gibench.study.regions import WHOLE
from gibench.study.settle import Settled, SettleOptions, settled_remark
from gibench.techniques.job import Job
from gibench.techniques.registry import declared_counts


@dataclass
class QualityOutcome:
    """What came out.

    Attributes:
        rows: of :func:`columns`; one per configuration and region.
        groups: finished ones.
        first_error: the first thing that went wrong.
        interrupted: whether Ctrl-C ended it early.
    """

    rows: list[dict[str, Any]] = field(default_factory=list)
    groups: list[Group] = field(default_factory=list)
    first_error: GibenchError | None = None
    interrupted: bool = False


DEFAULT_TARGET_ERROR = 0.02
"""Mean standard error over mean irradiance; the bias over many receivers is known far better."""


@dataclass(frozen=True)
class QualityOptions:
    """How techniques are compared with the truth.

    Attributes:
        settle: when a technique counts as settled.
        light_frame: the lights stand still where they are in this frame.
        bounces: of the reference; None for any number.
        target_error: of the reference, mean standard error over mean irradiance.
        regions: as typed (see :func:`gibench.study.regions.read_regions`).
        reference: ``receivers.npz`` whose reference is taken instead of path tracing.
        reference_seed: of the path tracer.
        reference_paths: per receiver at most; None for as many as the target error takes.
        flip: whether FLIP is wanted, which takes longer than all other metrics together.
        watched: whether further frames are run for flicker and lag.
    """

    settle: SettleOptions = field(default_factory=SettleOptions)
    light_frame: int = 0
    bounces: int | None = None
    target_error: float = DEFAULT_TARGET_ERROR
    regions: tuple[str, ...] = ()
    reference: Path | None = None
    reference_seed: int = 1
    reference_paths: int | None = None
    flip: bool = True
    watched: bool = False


@dataclass(eq=False)
class Group:
    """Configurations on the same receivers: one ``receivers.npz``.

    Attributes:
        name: scene and receivers, for a folder.
        scene: with standing lights.
        lightmap: the receivers.
        truth: the reference.
        regions: masks by name.
        open: (n,) receivers that are wholly outside of geometry (:mod:`gibench.study.hidden`).
        about: what the reference is of.
        results: (n, 3) irradiance by name.
        reference_key: of the traced reference in the store; empty where it is from a file.
    """

    name: str
    scene: Scene
    lightmap: Lightmap = field(repr=False)
    truth: Truth = field(repr=False)
    regions: dict[str, Bools] = field(repr=False)
    open: Bools = field(repr=False)
    about: dict[str, Any]
    results: dict[str, Doubles] = field(default_factory=dict, repr=False)
    reference_key: str = ""

    @cached_property
    def flat(self) -> list[FlatChart]:
        """Its flat surfaces."""
        return flat_charts(self.lightmap)

    @cached_property
    def dark_area(self) -> float:
        """Share of the surface that is dark: where light is a leak."""
        area = self.lightmap.receivers.area.astype(np.float64)
        dark = faults.dark(self.truth.value, self.truth.stderr, area, self.open)
        return float(area[dark].sum() / area.sum())


def columns(axes: Sequence[Axis]) -> tuple[str, ...]:
    """The columns of ``quality.csv``, with one for each of ``axes``."""
    return (
        *("technique", "scene", "settings", "bias", "rel_mse", "lab_l_mse", "flip", "time_ms"),
        *("memory_bytes", "rel_l2", "ssim", "region"),
        *(f"{name}_noise" for name in METRICS),
        *("result", "variant", "layout", "profile", "workgroup_size"),
        *(axis.column for axis in axes),
        *declared_counts(),
        *("receivers", "camera", "light_frame", "bounces", "reference_paths", "reference_error"),
        *("frames", "settled", "change", "memory_budget_bytes", "status", "reason"),
        *("uncovered", "bias_covered", "bias_covered_noise"),
        *("hidden", "bias_open", "bias_open_noise", "rel_l2_open", "rel_l2_open_noise"),
        *("rest", "frames_to_rest", "ms_to_rest", "gi_ms", "bake_seconds"),
        *(fault.name for fault in faults.FAULTS),
        *("dark_area", "lag_light_reason"),
    )


def rows_of(
    settled: Settled, group: Group, options: QualityOptions, name: str
) -> list[dict[str, Any]]:
    """One row of :func:`columns` per region."""
    found = errors(group.truth, settled.irradiance, group.regions, with_flip=options.flip)
    common = _keys(settled.job, group, options, name) | {
        "time_ms": settled.times.median_ms,
        "memory_bytes": settled.memory_bytes,
        **{name: settled.counts.get(name) for name in declared_counts()},
        "frames": settled.frames,
        "settled": settled.settled,
        "change": settled.change,
        "status": OK,
        "reason": settled_remark(
            settled=settled.settled,
            frames=settled.frames,
            change=settled.change,
            unrested=settled.unrested,
        ),
        "rest": settled.rest,
        "frames_to_rest": settled.frames_to_rest,
        "ms_to_rest": settled.ms_to_rest,
        "gi_ms": settled.gi_ms,
        "bake_seconds": settled.bake_seconds,
    }
    rows = [
        {**common, "region": region, **_figures(measures)} for region, measures in found.items()
    ]
    rows[0] |= _cover(settled, group) | _among_open(settled, group) | _faults(settled, group)
    return rows


def _faults(settled: Settled, group: Group) -> dict[str, Any]:
    """The figures of :data:`gibench.measure.statistics.faults.FAULTS`, and why one is not told."""
    truth, area = group.truth, group.lightmap.receivers.area.astype(np.float64)
    result = settled.irradiance
    flat = flat_errors(group.flat, result, truth.value, truth.stderr, area)
    return {
        "leak": faults.leak(result, truth.value, truth.stderr, area, group.open),
        **asdict(settled.observed),
        "blotches": blotches(flat),
        "missing": faults.missing(result, settled.covered, truth.value, truth.stderr),
        "dark_area": group.dark_area,
    }


def settings_in_words(settings: Any) -> str:
    """The settings that differ from the defaults, ``name=value`` joined by commas."""
    usual = type(settings)()
    changed = [
        f"{item.name}={getattr(settings, item.name)}"
        for item in fields(settings)
        if getattr(settings, item.name) != getattr(usual, item.name)
    ]
    return ", ".join(changed) or "default"


def result_names(jobs: Sequence[Job]) -> list[str]:
    """A name for the result of each of ``jobs``.

    The technique's own where it is the only one on its receivers, with more in words otherwise;
    two never share one.
    """
    names: list[str] = []
    for mine in jobs:
        others = [
            c
            for c in jobs
            if c.technique == mine.technique
            and (c.scene, c.receivers) == (mine.scene, mine.receivers)
        ]
        parts = [mine.technique]
        for differs in (
            lambda c: settings_in_words(c.settings),
            _shape,
            lambda c: c.profile.name,
            lambda c: f"work-group {c.group_size}",
        ):
            if len({differs(other) for other in others}) > 1:
                parts.append(differs(mine))
        names.append(", ".join(parts))
    return names


def _shape(job: Job) -> str:
    return " ".join(filter(None, (job.variant, job.layout if job.layout == SIMT else None)))


def _figures(measures: dict[str, Measure]) -> dict[str, float]:
    values = {name: measures[name].value for name in METRICS}
    return values | {f"{name}_noise": measures[name].noise for name in METRICS}


def _cover(settled: Settled, group: Group) -> dict[str, float]:
    """How many receivers the technique says nothing of, and the bias over the others."""
    measure = errors_among(group.truth, settled.irradiance, settled.covered)["bias"]
    return {
        "uncovered": int((~settled.covered).sum()),
        "bias_covered": measure.value,
        "bias_covered_noise": measure.noise,
    }


def _among_open(settled: Settled, group: Group) -> dict[str, float]:
    """How many receivers lie in part inside of geometry, and the errors over the others."""
    found = errors_among(group.truth, settled.irradiance, group.open)
    named = {f"{name}_open": found[name] for name in ("bias", "rel_l2")}
    return {
        "hidden": int((~group.open).sum()),
        **{name: measure.value for name, measure in named.items()},
        **{f"{name}_noise": measure.noise for name, measure in named.items()},
    }


def _keys(
    job: Job,
    group: Group,
    options: QualityOptions,
    name: str,
) -> dict[str, Any]:
    return {
        "technique": job.technique,
        "scene": group.scene.name,
        "settings": settings_in_words(job.settings),
        "result": name,
        "variant": job.variant,
        "layout": job.layout,
        "profile": job.profile.name,
        "workgroup_size": job.group_size,
        "receivers": len(group.lightmap.receivers),
        "camera": group.about["camera"],
        "light_frame": options.light_frame,
        "bounces": options.bounces,
        "reference_paths": group.about["paths"],
        "reference_error": group.truth.relative_error,
        "memory_budget_bytes": job.profile.memory_budget_bytes,
    }


def refused(
    job: Job,
    group: Group,
    options: QualityOptions,
    name: str,
    error: GibenchError,
) -> dict[str, Any]:
    """The row of a job that did not run."""
    status = SKIPPED if isinstance(error, CannotRun) else FAILED
    keys = _keys(job, group, options, name)
    return {**keys, "region": WHOLE, "status": status, "reason": without_paths(str(error))}
