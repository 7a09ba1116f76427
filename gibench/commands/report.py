"""``gibench report``, and :func:`gibench.make_report`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gibench.commands import asked
from gibench.errors import BadInput
from gibench.measure.runfolder.folder import write_atomically
from gibench.report.loaded import (
    QUALITY,
    LoadedRun,
    answers_of,
    load_quality,
    load_run,
    projected_text,
)
from gibench.report.markdown import report as markdown
from gibench.report.page import page


def _markdown(run: LoadedRun) -> str:
    found = answers_of(run.path, run.record, run.frames)
    return markdown(run.passes, run.frames, run.record, found) + projected_text(run.path)


@dataclass(frozen=True)
class Report:
    """Runs to read.

    Attributes:
        text: Markdown, or a self-contained page.
        path: of the file that holds it; None where none was asked for.
    """

    text: str = field(repr=False)
    path: Path | None


def make_report(
    runs: str | Path | Sequence[str | Path],
    html: bool = False,
    out: str | Path | None = None,
) -> Report:
    """Show runs again, as ``gibench report`` does; its help says what everything is.

    Raises:
        BadInput: there is no run among them, or one is damaged, unfinished or of a newer gibench.
        GibenchError: the file cannot be written.
    """
    folders = [Path(each) for each in dict.fromkeys(map(str, asked.several(runs)))]
    qualities = [load_quality(path) for path in folders if (path / QUALITY).exists()]
    loaded = [load_run(path) for path in folders if not (path / QUALITY).exists()]
    if not loaded:
        raise BadInput("no run to report", mend="give a folder that gibench run left as well")
    if html:
        text = page(loaded, qualities)
        target = Path(out) if out else loaded[0].path / "report.html"
    else:
        text = "\n".join(_markdown(run) for run in loaded)
        if out is None:
            return Report(text, None)
        target = Path(out)
    if target.is_dir():
        raise BadInput("this is a folder", where=target, mend="give a file with --out")
    write_atomically(target, text.encode())
    return Report(text, target)
