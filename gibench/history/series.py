"""The times of a history as series: one figure a run, of one pass on one machine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from gibench.history.entries import FRAME
from gibench.history.store import History

if TYPE_CHECKING:
    import pandas as pd

_QUESTION = """
SELECT r.machine, r.machine_text, r.runtime, c.series, c.label, c.technique, s.pass, r.run,
       r.started_utc, r.revision, r.dirty, r.folder, r.environment,
       any_value(c.unit) AS unit, median(s.value) AS median, count(*) AS frames
FROM samples s
JOIN configurations c ON c.run = s.run AND c.configuration = s.configuration
JOIN runs r ON r.run = s.run
GROUP BY r.machine, r.machine_text, r.runtime, c.series, c.label, c.technique, s.pass, r.run,
         r.started_utc, r.revision, r.dirty, r.folder, r.environment
HAVING median(s.value) > 0  -- a pass that does nothing in most frames has no trend
ORDER BY r.machine, r.runtime, c.label, c.series, s.pass, r.started_utc, r.run
"""


@dataclass(frozen=True)
class Series:
    """One pass of one configuration over the runs of one machine and OpenCL runtime, oldest first.

    Attributes:
        machine: in words.
        runtime: OpenCL platform, driver and device.
        label: the configuration in words.
        technique: its technique.
        pass_name: the pass, ``(frame)`` or ``(gi)``.
        unit: ``ms``, or ``ratio`` where runs were timed in turns with a baseline ('gibench ab').
        runs: a row a run: run, started_utc, revision, dirty, folder, environment, median, frames.
    """

    machine: str
    runtime: str
    label: str
    technique: str
    pass_name: str
    unit: str
    runs: pd.DataFrame

    @property
    def logs(self) -> npt.NDArray[np.float64]:
        """(runs,) natural logarithms of the medians."""
        times: npt.NDArray[np.float64] = self.runs["median"].to_numpy(np.float64)
        return np.log(np.maximum(times, 1e-9))

    @property
    def name(self) -> str:
        """What it is of, in words."""
        what = "the frame" if self.pass_name == FRAME else self.pass_name
        return f"{what} of {self.label}"


def read_series(history: History) -> list[Series]:
    """Every series of a history.

    Raises:
        BadInput: there is no history.
    """
    return list(_split(history.ask(_QUESTION)))


def _split(table: pd.DataFrame) -> Iterator[Series]:
    keys = ["machine", "runtime", "series", "pass"]
    for _, rows in table.groupby(keys, sort=False):
        first = rows.iloc[0]
        columns = ["run", "started_utc", "revision", "dirty", "folder", "environment"]
        yield Series(
            machine=str(first["machine_text"]),
            runtime=str(first["runtime"]),
            label=str(first["label"]),
            technique=str(first["technique"] or ""),
            pass_name=str(first["pass"]),
            unit=str(first["unit"]),
            runs=rows[[*columns, "median", "frames"]].reset_index(drop=True),
        )
