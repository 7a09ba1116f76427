"""What became of a job: for the run record, from which every table is made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from gibench.measure.runfolder.axes import Axis, axis_values, plain_settings
from gibench.techniques.job import AUTO, Job
from gibench.techniques.registry import declared_counts
from gibench.techniques.technique import Work

OK, SKIPPED, FAILED = "ok", "skipped", "failed"
AT_REST = "at rest"
"""What ``rest`` says of a technique that was."""
WHOLE_FRAME = "(frame)"
"""Stands for the pass in the row of a configuration that never came to its passes."""


@dataclass
class PassResult:
    """One pass of a configuration; ``workgroup_size`` where it has one of its own."""

    name: str
    work: Work = field(default_factory=Work)
    status: str = OK
    reason: str = ""
    workgroup_size: int | None = None
    stage: str = ""


@dataclass
class JobResult:
    """One job, run or not: a configuration of the run's tables.

    Attributes:
        number: of the configuration, counted from 1 in the order of the run.
        job: what was asked.
        scene: the scene's own name.
        status: ``ok``, ``skipped`` (the profile or budget forbids it, or a pass of it) or
            ``failed`` (something went wrong).
        reason: why it is not ``ok``, or what a reader must know.
        counts: probes, receivers, surfels as the technique has them.
        receivers_asked: what was aimed for before ``--fit``.
        group: configurations of one group took turns.
        warmup: frames run before those that count.
        rest: whether it was at rest then, in words; empty where its technique does not tell.
        frames_to_rest: after so many it was, if it was.
        ms_to_rest: that those took.
        pictured: the scene's frame that its images show; None where none were taken.
        frames: measured.
        stopped: why no further frame was measured.
        beside_ms: wall times of constant work after each of its frames, where they differ.
        own_ms: what each of these frames kept the device busy itself.
        memory_bytes: the most that was allocated at once.
        bake_seconds: wall time that baking took, now or when it was stored; None where nothing is.
        notes: for the report.
        base_size: work-group size, where ``auto`` was asked and another than the profile's found.
        sweep: the work-group sizes tried and chosen, where they were.
    """

    number: int
    job: Job
    scene: str
    group: int = 1
    warmup: int = 0
    rest: str = ""
    frames_to_rest: int | None = None
    ms_to_rest: float | None = None
    pictured: int | None = None
    stopped: str = ""
    status: str = OK
    reason: str = ""
    passes: list[PassResult] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    receivers_asked: int | None = None
    frames: int = 0
    beside_ms: list[float] = field(default_factory=list)
    own_ms: list[float] = field(default_factory=list)
    memory_bytes: int = 0
    camera: str = ""
    bake_seconds: float | None = None
    notes: list[str] = field(default_factory=list)
    base_size: int | None = None
    sweep: dict[str, Any] | None = None
    error: BaseException | None = field(default=None, repr=False)

    def refuse(self, status: str, reason: str, error: BaseException | None = None) -> None:
        """Mark the configuration and the passes it still had as not run."""
        self.status, self.reason, self.error = status, reason, error
        for item in self.passes:
            if item.status == OK and not self.frames:
                item.status, item.reason = status, reason
        if not self.passes:
            self.passes = [PassResult(WHOLE_FRAME, status=status, reason=reason)]

    def keys(self, axes: Sequence[Axis], workgroup_size: int | None = None) -> dict[str, Any]:
        """The columns that name it in every table; a pass may have a work-group size of its own."""
        job = self.job
        return {
            "technique": job.technique,
            "variant": job.variant,
            "layout": job.layout,
            "scene": self.scene,
            "profile": job.profile.name,
            "workgroup_size": workgroup_size or self.group_size,
            **axis_values(job, axes),
        }

    @property
    def group_size(self) -> int:
        """Work-items per group wherever a pass has none of its own."""
        return self.base_size or self.job.group_size

    def record(self, axes: Sequence[Axis]) -> dict[str, Any]:
        """As ``run.json`` has it."""
        return {
            "configuration": self.number,
            **self.keys(axes),
            **{name: self.counts.get(name) for name in (*declared_counts(), "receivers")},
            "counts": dict(self.counts),
            "receivers_asked": self.receivers_asked,
            "frames": self.frames,
            "warmup": self.warmup,
            "rest": self.rest,
            "frames_to_rest": self.frames_to_rest,
            "ms_to_rest": self.ms_to_rest,
            "pictured": self.pictured,
            "stopped": self.stopped,
            "beside_ms": [round(ms, 4) for ms in self.beside_ms],
            "own_ms": [round(ms, 4) for ms in self.own_ms],
            "group": self.group,
            "camera": self.camera,
            "bake_seconds": self.bake_seconds,
            "memory_bytes": self.memory_bytes,
            "memory_budget_bytes": self.job.profile.memory_budget_bytes,
            "status": self.status,
            "reason": self.reason,
            "notes": list(self.notes),
            "settings": plain_settings(self.job.settings),
            "auto_workgroup": self.job.workgroup_size == AUTO,
            "workgroup_sweep": self.sweep,
            "passes": [
                {
                    "pass": p.name,
                    "stage": p.stage,
                    **asdict(p.work),
                    "status": p.status,
                    "reason": p.reason,
                    "workgroup_size": p.workgroup_size or self.group_size,
                }
                for p in self.passes
            ],
        }
