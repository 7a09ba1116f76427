"""A run's folder as pandas tables: what ``gibench.load_run`` gives to a notebook."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from gibench.errors import BadInput
from gibench.measure.runfolder.stored_run import read_run
from gibench.report.projected import PROJECTED, RATIOS, projected_section, ratios_section
from gibench.report.tables import frames_table, passes_table
from gibench.report.which_one import Answer, Budgets, answers


@dataclass(frozen=True)
class LoadedRun:
    """A run.

    Attributes:
        path: its folder.
        record: the content of ``run.json``.
        samples: one row per pass and frame.
        passes: one row per pass and configuration.
        frames: one row per configuration.
        projected: ranges on devices that are not here; None where nothing was projected.
    """

    path: Path
    record: dict[str, Any]
    samples: pd.DataFrame
    passes: pd.DataFrame
    frames: pd.DataFrame
    projected: pd.DataFrame | None = None


QUALITY, ERRORS = "quality.csv", "errors.csv"


def answers_of(path: Path, record: Mapping[str, Any], frames: pd.DataFrame) -> list[Answer]:
    """Which technique fits, of the run in ``path``: by the budgets that it was asked for, with the
    errors that were measured.
    """
    asked = record["arguments"].get("budgets") or {}
    file = path / ERRORS
    errors = pd.read_csv(file) if file.exists() else None
    return answers(frames, record, errors, Budgets(**asked), projected_in(path))


def projected_in(path: Path) -> pd.DataFrame | None:
    """The projected ranges of the run in ``path``; None where there are none."""
    file = path / PROJECTED
    return pd.read_csv(file) if file.is_file() else None


def projected_text(path: Path) -> str:
    """The sections of what is projected of the run in ``path``; empty where nothing is."""
    if (projected := projected_in(path)) is None:
        return ""
    text, file = "\n" + projected_section(projected), path / RATIOS
    ratios = ratios_section(pd.read_csv(file)) if file.is_file() else ""
    return f"{text}\n{ratios}" if ratios else text


@dataclass(frozen=True)
class LoadedQuality:
    """What ``gibench quality`` left: its folder and its table, one row per result and region."""

    path: Path
    table: pd.DataFrame


def load_quality(path: Path) -> LoadedQuality:
    """The errors in the folder ``path``.

    Raises:
        BadInput: they cannot be read or are not of gibench.
    """
    file = path / QUALITY
    try:
        table = pd.read_csv(file)
    except (OSError, ValueError) as error:
        raise BadInput("it cannot be read", where=file, mend="it is damaged") from error
    for name in ("technique", "settings", "region", "rel_l2", "bias", "time_ms", "memory_bytes"):
        if name not in table.columns:
            raise BadInput(f"it has no column '{name}'", where=file)
    return LoadedQuality(path, table)


def load_run(path: str | Path) -> LoadedRun:
    """The run in the folder ``path``; its tables are computed from its samples.

    Raises:
        BadInput: it is no run of gibench, is damaged, unfinished, or of a newer gibench.
    """
    run = read_run(Path(path))
    return LoadedRun(
        run.path,
        run.record,
        run.samples,
        passes_table(run.samples, run.record),
        frames_table(run.samples, run.record),
        projected_in(run.path),
    )
