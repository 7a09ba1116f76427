"""The files of a run that are made from its samples: tables and the report."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from gibench.measure.runfolder.folder import SAMPLES, RunFolder
from gibench.report.loaded import answers_of, projected_text
from gibench.report.markdown import report
from gibench.report.roofline import write_roofline
from gibench.report.tables import csv_text, frames_table, passes_table


def write_tables(folder: RunFolder, record: Mapping[str, Any]) -> None:
    """Write the tables and the report of a run from its stored samples.

    Raises:
        GibenchError: the disk refuses.
    """
    _, passes, frames = tables_of(folder.path, record)
    folder.write_text("passes.csv", csv_text(passes))
    folder.write_text("frames.csv", csv_text(frames))
    write_roofline(folder.path, passes, record)
    found = answers_of(folder.path, record, frames)
    table = pd.concat([one.table.assign(scene=one.scene, profile=one.profile) for one in found])
    folder.write_text("which.csv", csv_text(table))
    text = report(passes, frames, record, found) + projected_text(folder.path)
    folder.write_text("report.md", text)


def tables_of(
    path: Path, record: Mapping[str, Any]
) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Samples, passes and frames of the run in ``path``."""
    samples = pd.read_csv(path / SAMPLES)
    return samples, passes_table(samples, record), frames_table(samples, record)
