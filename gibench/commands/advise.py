"""``gibench advise``, and :func:`gibench.advise`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd

from gibench.commands import asked
from gibench.commands.bounds import within_bounds
from gibench.device.selection import select_cl_device
from gibench.errors import BadInput, GibenchError, Interrupted
from gibench.measure.plan.grid import check_settings_names
from gibench.measure.plan.shard import Shard, labels_of
from gibench.measure.record import on_one_machine, study_record
from gibench.measure.runfolder.axes import axes_of
from gibench.measure.runfolder.folder import RunFolder
from gibench.measure.session.shared import Shared
from gibench.profiles import DeviceProfile
from gibench.report.advice import advice_report, plot_advice
from gibench.report.limits import LEAK, Limit, lifted, read_limits
from gibench.report.projected import PROJECTED, ranking_section
from gibench.report.tables import csv_text
from gibench.study.advise import RECEIVER_SHARES, advice, competing, misfit, sweep
from gibench.study.quality import check_views, compare, group_of
from gibench.study.quality_rows import QualityOptions, columns
from gibench.study.regions import WHOLE
from gibench.study.rows import Rows
from gibench.study.settle import SettleOptions
from gibench.study.site import Site
from gibench.study.where import timed_where
from gibench.techniques.job import Job
from gibench.techniques.registry import techniques
from gibench.trace.extra import require_extra
from gibench.work import Executor

SETTINGS = "settings.csv"
"""Every setting that was tried, as it came."""


@dataclass(frozen=True)
class AdviceResult:
    """What was tried, and what is advised.

    Attributes:
        folder: with everything that was written.
        table: what was tried, best error first among what fits: ``advice.csv``.
        limits: what was asked for.
        lifted: what would fit if one limit were lifted, and by how much.
        profile: name of the profile.
        cpu: that the times are of.
        error: what is not fine: nothing fits the budgets, or it was interrupted.
        projected: settings by their projected GI on another device, where that was asked.
    """

    folder: Path
    table: pd.DataFrame = field(repr=False)
    limits: tuple[Limit, ...]
    lifted: pd.DataFrame = field(repr=False)
    profile: str
    cpu: str
    error: GibenchError | None
    projected: pd.DataFrame | None = field(default=None, repr=False)


@within_bounds
def advise(
    device_profile: str = "iphone7",
    budget_ms: float | None = None,
    gi_budget_ms: float | None = None,
    budget: asked.Texts = (),
    scene: str = "cornell-box",
    technique: asked.Texts = (),
    variant: asked.Texts = ("tuned",),
    sh_order: asked.Numbers = None,
    probes: asked.Numbers = None,
    receivers: asked.Numbers = None,
    settings: asked.SettingsAsked = None,
    light_frame: int = 0,
    target_error: float = 0.05,
    reference_paths: int | None = None,
    frames: int = 256,
    resolution: str | tuple[int, int] = "1334x750",
    camera: str | int | None = None,
    project: str | None = None,
    shard: str | None = None,
    out: str | Path | None = None,
    seed: int = 0,
    device: int | None = None,
    cache_dir: str | Path | None = None,
    executor: Executor | None = None,
) -> AdviceResult:
    """Try techniques and settings on a scene, as ``gibench advise`` does; its help says what
    everything is.

    ``executor`` computes what is baked and what is tried (:mod:`gibench.work.executors`); no result
    depends on it, and frames are timed one setting at a time.

    Raises:
        BadInput: an input is wrong.
        Interrupted: before anything was measured.
        GibenchError: the folder cannot be written.
    """
    # The budget is no part of it: what is there is judged by another one without measuring again.
    arguments = asked.recorded(locals(), "light_frame", "target_error", "reference_paths")
    arguments["command"] = "advise"
    limits = read_limits(budget_ms, gi_budget_ms, asked.several(budget))
    projected_on = _projected_on(project)
    shot = asked.shot_of(resolution, camera)
    profile = asked.load_profiles([device_profile])[0]
    specs = asked.find_techniques(asked.several(technique) or tuple(techniques()))
    chosen = asked.read_settings(settings)
    check_settings_names(specs, chosen)
    by_option = asked.by_option(sh_order, probes)
    cl_device = select_cl_device(device)
    site = Site(asked.cache_folder(cache_dir), seed, device, executor)
    shared = site.standing(light_frame)
    if found := asked.contents([scene], shared):
        arguments["scene_contents"] = found
    all_receivers = shared.scene(scene).receivers
    shares = tuple(max(1, round(all_receivers * share)) for share in RECEIVER_SHARES)
    jobs = sweep(
        profile,
        specs,
        scene,
        shared.scene(scene),
        asked.several(variant),
        asked.several(receivers) or shares,
        by_option,
        chosen,
        shot,
        seed,
    )
    how = QualityOptions(
        SettleOptions(frames),
        light_frame=light_frame,
        target_error=target_error,
        reference_paths=reference_paths,
        flip=False,  # none of its tables shows it
    )
    check_views(jobs, how, site)
    part, own = Shard.parse(shard), range(len(jobs))
    if part is not None:
        own = part.positions(len(jobs))
        numbers = [[str(position + 1)] for position in own]
        tables = {SETTINGS: ["number"]}
        arguments["shard"] = part.record(labels_of(jobs), own=numbers, tables=tables)
    if any(limit.metric.name == LEAK for limit in limits):
        _check_dark(jobs[0], how, site)
    folder = asked.folder_for(out, "advice", [profile.name], arguments)
    axes = axes_of(jobs)
    kept = Rows.at(folder.path / SETTINGS, ("number",), columns(axes))
    done = {
        number
        for number in range(1, len(jobs) + 1)
        if number - 1 not in own or kept.done({"number": number})
    }
    complete = len(done) == len(jobs)
    there = None if complete else timed_where(executor, profile, device)
    record = study_record(arguments, cl_device, there)
    record = on_one_machine(folder, record, complete=complete)
    folder.write_record(record)
    outcome = compare(
        jobs,
        how,
        site,
        axes=axes,
        executor=executor,
        keep=lambda number, rows: kept.add([{"number": number, **row} for row in rows]),
        done=done,
    )
    tried = kept.table().fillna({"reason": ""})
    rows = tried.drop(columns="number")
    if rows.empty:
        raise Interrupted("interrupted before anything was measured")
    table = advice(rows, limits)
    result = AdviceResult(
        folder=folder.path,
        table=table,
        limits=limits,
        lifted=lifted(table[competing(table)], limits),
        profile=profile.name,
        cpu=record["environment"]["cpu"],
        error=_interrupted(len(table), len(own), folder.path) if outcome.interrupted else None,
    )
    if part is not None:  # which is best is known when all are there
        return result
    if result.error is None:
        result = replace(result, error=misfit(table, limits))
    if projected_on is not None and not outcome.interrupted:
        ranking = _ranked(jobs, tried, projected_on, shared, cl_device)
        result = replace(result, projected=ranking)
    _write(folder, result, shared.scene(scene).warnings)
    return result


def _write(folder: RunFolder, result: AdviceResult, warnings: Sequence[str]) -> None:
    """Leave the tables, the report and the plot.

    Raises:
        GibenchError: one cannot be written.
    """
    table, more = result.table, result.lifted
    folder.write_text("advice.csv", csv_text(table))
    folder.write_text("lifted.csv", csv_text(more))
    text = advice_report(table, more, result.profile, result.limits, result.cpu, warnings)
    if result.projected is not None:
        folder.write_text(PROJECTED, csv_text(result.projected))
        text += "\n" + ranking_section(result.projected)
    folder.write_text("advice.md", text)
    if (table["status"] == "ok").any():
        plot_advice(folder.path / "pareto", table, result.limits, result.cpu)


def _check_dark(job: Job, how: QualityOptions, site: Site) -> None:
    """Refuse a scene in which no light can leak.

    Raises:
        BadInput: nothing in it is dark.
    """
    group = group_of(job, how, site)
    if not group.dark_area:
        raise BadInput(
            f"the scene '{group.scene.name}' has no dark region that is known as such at a target "
            f"error of {how.target_error:g}, so that no light can leak into it",
            where="--budget leak",
            mend="leave it out, or give a scene that has one, such as two-rooms",
        )


def _interrupted(tried: int, of: int, path: Path) -> Interrupted:
    return Interrupted(
        f"interrupted; {tried} of {of} settings were tried, see {path}; the same command with "
        f"--out {path} goes on from there"
    )


def _projected_on(name: str | None) -> DeviceProfile | None:
    if name is None:
        return None
    from gibench.commands.project import machine_profiles

    require_extra()
    return machine_profiles([name])[0]


def _ranked(
    jobs: Sequence[Job], tried: pd.DataFrame, profile: DeviceProfile, shared: Shared, cl_device: Any
) -> pd.DataFrame:
    """What ran, by its projected GI."""
    from gibench.commands.project import project_job, ranked

    whole = tried[(tried["region"] == WHOLE) & (tried["status"] == "ok")].set_index("number")
    found = {}
    for number in whole.index:
        ((_, each, _),) = project_job(jobs[number - 1], [profile], shared, cl_device)
        found[number] = each
    return ranked(found, profile, whole)
