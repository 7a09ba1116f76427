"""``gibench validate-projection``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from gibench.commands import asked
from gibench.errors import BadInput
from gibench.measure.runfolder.folder import RunFolder
from gibench.measure.runfolder.stored_run import read_record
from gibench.report.loaded import projected_in
from gibench.report.projected import PROJECTED
from gibench.report.tables import csv_text
from gibench.resources import data
from gibench.study.validation import frozen, orders, score
from gibench.trace.extra import require_extra

_PASSES = "passes.csv"


@dataclass(frozen=True)
class Validation:
    """Frozen predictions and what became of them.

    Attributes:
        summary: a row for each set and device.
        rows: every prediction with its measured time.
        best: what the model's choice among convolutions costs.
        hashes: of what was frozen.
    """

    summary: pd.DataFrame
    rows: pd.DataFrame = field(repr=False)
    best: pd.DataFrame
    hashes: dict[str, str] = field(repr=False)


def validate_projection(
    predictions: str | Path | None = None, out: str | Path | None = None
) -> Validation:
    """Score frozen predictions against what others measured.

    Args:
        predictions: their folder; gibench's own by default.
        out: folder for ``validation.csv`` and ``rows.csv``; none is written by default.

    Raises:
        BadInput: there are no predictions.
        CheckFailed: they are not those that were frozen.
        GibenchError: ``out`` cannot be written.
    """
    place = data("validation") / "predictions" if predictions is None else Path(predictions)
    found = frozen.thaw(place)
    rows = score.scored(found, score.measured())
    result = Validation(
        score.summary(rows, found.times), rows, score.best_of_convolution(rows), found.hashes
    )
    if out is not None:
        folder = RunFolder.create(Path(out), {"command": "validate-projection"})
        folder.write_text("validation.csv", csv_text(result.summary))
        folder.write_text("rows.csv", csv_text(rows))
        folder.write_text("best.csv", csv_text(result.best))
    return result


def predict_validation(
    folder: str | Path,
    cache_dir: str | Path | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> pd.DataFrame:
    """Trace and predict all that is validated on, and freeze it.

    Args:
        folder: where predictions go.
        cache_dir: where traces are kept.
        tell: is told how far it is.

    Raises:
        BadInput: a folder cannot be written.
        CannotRun: the extra is missing.
    """
    require_extra()
    table, times = frozen.predict(asked.cache_folder(cache_dir) / "traces", tell)
    frozen.freeze(Path(folder), table, times)
    return table


def check_orders(
    runs: Sequence[str | Path], out: str | Path | None = None
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Hold runs' measured passes against projections onto the device that ran them.

    Args:
        runs: folders of runs, each projected onto a profile of that device.
        out: folder for ``orders.csv`` and ``passes.csv``; none is written by default.

    Returns:
        A row for each runtime and device, and one for each pass.

    Raises:
        BadInput: one is no run, or was not projected.
        GibenchError: ``out`` cannot be written.
    """
    parts = []
    for run in map(Path, runs):
        record, projected = read_record(run), projected_in(run)
        if projected is None or not (run / _PASSES).is_file():
            missing = PROJECTED if projected is None else _PASSES
            raise BadInput(
                f"it has no {missing}",
                where=run,
                mend="project it onto a profile of the device that ran it: gibench project "
                "RUN -d PROFILE",
            )
        passes = pd.read_csv(run / _PASSES)
        parts.append(orders.held_against(passes, projected, record["device"]["platform"]))
    rows = pd.concat(parts)
    if rows.empty:
        raise BadInput("no pass of it was both measured and projected", where=runs[0])
    table = orders.summary(rows)
    if out is not None:
        folder = RunFolder.create(Path(out), {"command": "validate-projection"})
        folder.write_text("orders.csv", csv_text(table))
        folder.write_text(_PASSES, csv_text(rows))
    return table, rows
