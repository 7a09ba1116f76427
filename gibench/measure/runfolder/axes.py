"""Which settings are axes of a run, and the columns they have in every table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from gibench.techniques.job import Job
from gibench.techniques.registry import declared_axes, declared_counts

KEYS = ("technique", "variant", "layout", "scene", "profile", "workgroup_size")
"""Columns that name a configuration in every table, before those of its axes. ``layout`` is that of
``tuned``; empty as ``published``, and in runs from before there were two.
"""
LATER_KEYS = ("layout",)
"""Those that older runs lack."""

TAKEN = frozenset(
    (
        *KEYS,
        *("pass", "frame", "time_ms", "frame_wall_ms", "configuration", "receivers", "frames"),
        *("bytes", "flops", "rays", "stage", "status", "reason", "warmup", "outliers", "remarks"),
        *("rest", "frames_to_rest", "ms_to_rest", "within_budget", "stutter", "budget", "pace"),
        *("machine_longest", "machine_stutter"),
        *("stopped", "settings", "region", "result", "camera", "light_frame", "bounces"),
        *("settled", "change", "hidden", "uncovered", "bias", "flip", "ssim", "number", "fits"),
        *("leak", "dark_area", "flicker_p50", "flicker_p99", "blotches", "missing"),
        *("lag_light_half", "lag_light_95", "lag_object_half", "lag_object_95", "bake_seconds"),
        "lag_light_reason",
        *("fps", "real_time", "pareto", "memory_bytes", "memory_budget_bytes"),
    )
)
"""Columns that some table has already: a setting of such a name goes with its technique's."""


@dataclass(frozen=True)
class Axis:
    """A setting with a column in the tables.

    Attributes:
        column: its head.
        setting: the field of the settings.
        technique: whose; None for every technique that has it.
    """

    column: str
    setting: str
    technique: str | None = None

    def value(self, job: Job) -> Any:
        """Of ``job``; None where its technique has no such setting."""
        if self.technique not in (None, job.technique):
            return None
        return plain_settings(job.settings).get(self.setting)


def axes_of(jobs: Sequence[Job]) -> tuple[Axis, ...]:
    """Those that techniques declare, then every setting that is not the same in all jobs of a
    technique.
    """
    declared = declared_axes()
    axes = {name: Axis(name, name) for name in declared}
    taken = TAKEN | set(declared_counts())
    for technique in dict.fromkeys(job.technique for job in jobs):
        mine = [plain_settings(job.settings) for job in jobs if job.technique == technique]
        for name, value in mine[0].items():
            if name in declared or all(other[name] == value for other in mine):
                continue
            axis = Axis(name, name)
            if name in taken:
                axis = Axis(f"{technique}.{name}", name, technique)
            axes.setdefault(axis.column, axis)
    return tuple(axes.values())


def axis_values(job: Job, axes: Iterable[Axis]) -> dict[str, Any]:
    """The values of ``axes`` by column."""
    return {axis.column: axis.value(job) for axis in axes}


def recorded_axes(record: Mapping[str, Any]) -> tuple[str, ...]:
    """The axes' columns of a run's record; of one from before axes were recorded, those that
    techniques declare.
    """
    return tuple(record.get("axes", declared_axes()))


def recorded_counts(record: Mapping[str, Any]) -> tuple[str, ...]:
    """The counts that a run's tables show, likewise."""
    return tuple(record.get("counts", declared_counts()))


def steady_counts(counts: Mapping[str, str]) -> tuple[str, ...]:
    """Those in which chance has no part: they are the same in every frame of a configuration."""
    return tuple(name for name, of in counts.items() if name == of)


def plain_settings(settings: Any) -> dict[str, Any]:
    """A technique's settings as tables and ``run.json`` have them."""
    plain = (bool, int, float, str, type(None))
    return {
        name: value if isinstance(value, plain) else str(value)
        for name, value in asdict(settings).items()
    }
