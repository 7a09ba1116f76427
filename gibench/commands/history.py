"""``gibench history``: runs kept over weeks, and the change that is found in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gibench.commands import asked
from gibench.errors import BadInput, CheckFailed, GibenchError
from gibench.history.entries import read_entry
from gibench.history.page import page
from gibench.history.series import Series, read_series
from gibench.history.store import History
from gibench.measure.runfolder.folder import RECORD, write_atomically
from gibench.measure.statistics.steps import Step, find_steps

if TYPE_CHECKING:
    import pandas as pd

DEFAULT = Path("results") / "history.duckdb"


@dataclass(frozen=True)
class Added:
    """What ``add`` did: ``new`` runs kept, ``known`` that were there already."""

    new: int
    known: int


@dataclass(frozen=True)
class Found:
    """A step of a series, with the revisions it lies between."""

    series: Series
    step: Step

    @property
    def between(self) -> tuple[str, str]:
        """Revision of the last run before it and of the first after it."""
        revisions = self.series.runs["revision"]
        return str(revisions.iloc[self.step.at - 1]), str(revisions.iloc[self.step.at])

    @property
    def age(self) -> int:
        """Runs since, the first slower one counted."""
        return len(self.series.runs) - self.step.at


@dataclass(frozen=True)
class Checked:
    """What ``check`` found.

    Attributes:
        found: every established step, the latest first.
        series: how many series were searched.
        short: how many of them have too few runs for any step.
        error: set where a recent step made something slower.
    """

    found: tuple[Found, ...]
    series: int
    short: int
    error: GibenchError | None

    @property
    def table(self) -> pd.DataFrame:
        """A row a step."""
        import pandas as pd

        rows = [
            {
                "what": one.series.name,
                "ratio": one.step.ratio,
                "low": one.step.low,
                "high": one.step.high,
                "after": one.between[0],
                "by": one.between[1],
                "runs_since": one.age,
                "machine": one.series.machine,
            }
            for one in self.found
        ]
        columns = ["what", "ratio", "low", "high", "after", "by", "runs_since", "machine"]
        return pd.DataFrame(rows, columns=columns)


def history_add(sources: Sequence[str | Path], history: str | Path = DEFAULT) -> Added:
    """Keep runs, files of pytest-benchmark, or all runs of other histories.

    Everything is read before anything is kept, but for other histories.

    Raises:
        BadInput: one of them is nothing of the kind.
        GibenchError: the history cannot be written.
    """
    store = History(Path(history))
    entries, others = [], []
    for source in map(Path, asked.several([str(each) for each in sources])):
        if source.resolve() == store.path.resolve():
            raise BadInput("a history cannot be added to itself", where=source)
        if source.suffix == ".duckdb" or (source.is_dir() and _is_history(source)):
            others.append(History(source))
        else:
            entries.append(read_entry(source))
    new, total = store.add(entries), len(entries)
    for other in others:
        merged = list(other.entries())
        new, total = new + store.add(merged), total + len(merged)
    return Added(new, total - new)


def history_check(history: str | Path = DEFAULT, threshold: str = "5%", last: int = 20) -> Checked:
    """Search every series for lasting changes.

    Args:
        history: a ``.duckdb`` file or a folder.
        threshold: the least change that matters, for instance ``5%``.
        last: a slowdown counts as new while at most so many runs of its series have followed.

    Raises:
        BadInput: there is no history, or an option makes no sense.
    """
    limit = asked.percentage(threshold)
    if last < 1:
        raise BadInput("fewer than one run makes no check", where="--last", mend="give 1 or more")
    series = read_series(History(Path(history)))
    found = [Found(one, step) for one in series for step in find_steps(one.logs, limit)]
    found.sort(key=lambda one: (one.age, one.series.name))
    recent = [one for one in found if one.step.slower and one.age <= last]
    short = sum(len(one.runs) < 8 for one in series)
    return Checked(tuple(found), len(series), short, _verdict(recent))


def history_page(
    history: str | Path = DEFAULT, out: str | Path | None = None, threshold: str = "5%"
) -> Path:
    """Write the page of all series with their steps; its path.

    Raises:
        BadInput: there is no history.
        GibenchError: the page cannot be written.
    """
    store, limit = History(Path(history)), asked.percentage(threshold)
    series = read_series(store)
    steps = [find_steps(one.logs, limit) for one in series]
    target = Path(out) if out else store.path.with_suffix(".html")
    if target.is_dir():
        raise BadInput("this is a folder", where=target, mend="give a file with --out")
    write_atomically(target, page(series, steps, target.parent).encode())
    return target


def _is_history(folder: Path) -> bool:
    return (folder / "runs").is_dir() and not (folder / RECORD).exists()


def _verdict(recent: Sequence[Found]) -> GibenchError | None:
    if not recent:
        return None
    first = recent[0]
    more = f" and {len(recent) - 1} more" if len(recent) > 1 else ""
    before, after = first.between
    return CheckFailed(
        f"{first.series.name} became {100 * (first.step.ratio - 1):.0f} % slower after revision "
        f"{before[:12]} and by {after[:12]}{more}"
    )
