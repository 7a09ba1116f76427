"""An experiment run: its points measured by an executor, or a shard of them, and its report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import pandas as pd

from gibench.errors import BadInput, GibenchError, Interrupted
from gibench.measure.machine.environment import cpu_name
from gibench.measure.plan.shard import Shard, labels_of
from gibench.measure.runfolder.folder import RunFolder
from gibench.measure.runfolder.results import OK
from gibench.progress import progress
from gibench.study.ahead import bake_ahead, site_for
from gibench.study.experiments.common import Context, Experiment, Measuring, Point, markdown
from gibench.study.experiments.kept import STATUS, Found, Kept
from gibench.study.rows import row_key
from gibench.work import Executor, Serial, Worker, elsewhere, run_in_order


def run_experiment(
    experiment: Experiment,
    context: Context,
    folder: RunFolder,
    executor: Executor | None = None,
    shard: Shard | None = None,
    cpu: str | None = None,
) -> pd.DataFrame:
    """Measure what is not in the folder yet, then write report, plots and pictures.

    Args:
        experiment: to repeat.
        context: where and how.
        folder: where everything is written, by this process alone.
        executor: measures the points, one after another by default; frames, which are timed, run
            one point at a time whatever it is.
        shard: whose points alone are measured, and what these need; None for all.
        cpu: that is timed, for the report; None for this one.

    Raises:
        Interrupted: by Ctrl-C; what was measured is kept and reported.
        BadInput: the folder holds another experiment, or a scene is wrong.
        GibenchError: nothing could be measured: the first reason.
    """
    kept = _kept(experiment, folder)
    points = _left(experiment, context, kept, shard)
    interrupted, first = False, None
    one_by_one, there = Serial(says_unit=False), context
    try:
        if elsewhere(executor):
            there = _sent(experiment, context, points, executor)
        with progress(experiment.title, len(points)) as advance:

            def told(unit: Measuring, found: Found) -> None:
                nonlocal first
                first = first or found.error
                kept.add(unit.point.key, found)
                advance(1)

            # Those that need others come after them.
            for wave in (False, True):
                units = [
                    Measuring(point, kept.arrays(point.needs), experiment.timed)
                    for point in points
                    if bool(point.needs) == wave
                ]
                common = experiment.measure, there
                run_in_order(executor or one_by_one, _measured, common, units, told)
    except KeyboardInterrupt:
        interrupted = True
    table = kept.table()
    if (table["status"] == OK).any():
        text = report(experiment, context, kept, table, interrupted, cpu or cpu_name())
        folder.write_text(f"{experiment.name}.md", text)
    if interrupted:
        raise Interrupted(
            f"interrupted; what was measured is kept in {kept.rows.path}, the same command goes on "
            "from there"
        )
    if first is not None and not (table["status"] == OK).any():
        raise first
    return table


def points_left(
    experiment: Experiment, context: Context, folder: RunFolder, shard: Shard | None = None
) -> list[Point]:
    """The points that are not in the folder yet.

    Raises:
        BadInput: the folder holds another experiment, or a scene is wrong.
    """
    return _left(experiment, context, _kept(experiment, folder), shard)


def _kept(experiment: Experiment, folder: RunFolder) -> Kept:
    columns = (*experiment.columns, *STATUS)
    return Kept.at(
        folder.path, experiment.name, experiment.keys, columns, experiment.samples,
        experiment.summarize,
    )  # fmt: skip


def _left(experiment: Experiment, context: Context, kept: Kept, shard: Shard | None) -> list[Point]:
    points = _share(experiment, context, shard)
    return [point for point in points if not kept.done(point.key)]


def _sent(
    experiment: Experiment, context: Context, points: list[Point], executor: Executor | None
) -> Context:
    """The context as points need it that are measured elsewhere, with bakes and truths done."""
    jobs = [point.job for point in points]
    bake_ahead(jobs, context.site)
    truths = set() if experiment.truth is None else {experiment.truth(context, j) for j in jobs}
    return replace(context, site=site_for(executor, jobs, context.site, truths - {""}))


def _share(experiment: Experiment, context: Context, shard: Shard | None) -> list[Point]:
    """The points of a shard; where one of them needs arrays of others, these are measured, too."""
    points = list(experiment.points(context))
    if shard is None:
        return points
    own = shard.positions(len(points))
    needy = any(points[position].needs for position in own)
    return [
        point
        for position, point in enumerate(points)
        if position in own or (needy and not point.needs)
    ]


def shard_record(experiment: Experiment, context: Context, shard: Shard) -> dict[str, Any]:
    """What the record says of a shard of ``experiment``.

    Raises:
        BadInput: nothing is left for some shard.
    """
    points = list(experiment.points(context))
    keys = [row_key(point.key, experiment.keys) for point in points]
    files = [f"{experiment.name}.csv"]
    files += [f"{experiment.name}-samples.csv"] if experiment.samples else []
    jobs = labels_of([point.job for point in points])
    return shard.record(
        [f"{key} {job}" for key, job in zip(keys, jobs, strict=True)],
        own=[list(key) for key in shard.share(keys)],
        tables={file: list(experiment.keys) for file in files},
    )


def _measured(
    common: tuple[Callable[[Context, Measuring, Worker], Found], Context],
    unit: Measuring,
    worker: Worker,
) -> Found:
    """Measure a point; one that cannot run has its reason, and the others go on."""
    measure, context = common
    try:
        found = measure(context, unit, worker)
        return found if worker.may_time else replace(found, rows=[_timeless(r) for r in found.rows])
    except BadInput:
        raise
    except GibenchError as error:
        return Found(error=error)


def _timeless(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row without times: they were taken beside others."""
    return {n: None if n.endswith("_ms") or n.startswith("ms_") else v for n, v in row.items()}


def report(
    experiment: Experiment,
    context: Context,
    kept: Kept,
    table: pd.DataFrame,
    interrupted: bool,
    cpu: str,
) -> str:
    """The experiment to read."""
    lines = [
        f"# {experiment.title}",
        f"After {experiment.source}.",
        f"**Measured on** {cpu} under the limits of "
        f"{', '.join(p.title for p in context.profiles)}: work-group sizes and memory. No time "
        "below is one of a modelled device.",
    ]
    if context.quick:
        lines.append("> **Quick:** small sizes that show that it works. The figures mean nothing.")
    if interrupted:
        lines.append("> **Interrupted:** not all points are here.")
    lines.append(experiment.present(context, kept, table))
    missing = table[table["status"] != OK]
    if len(missing):
        lines.append("## Not measured")
        lines.append(markdown(missing[[*experiment.keys, *STATUS]]))
    return "\n\n".join(lines) + "\n"
