"""``gibench report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gibench.errors import BadInput


def report(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Folders of run, and of quality.")
    ],
    html: Annotated[
        bool,
        typer.Option("--html", help="One self-contained page of all runs, instead of Markdown."),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="File to write; by default report.html in the first run's folder, Markdown to "
            "standard output.",
        ),
    ] = None,
) -> None:
    """Show runs again: as Markdown, or as one page with plots, sortable tables and images.

    The page needs no network. Several runs are put side by side, aligned by configuration; what
    quality left adds error against time. All figures are computed anew from the runs' samples.

    Examples:

      gibench report results/runs/20260101T120000Z-iphone7 --html

      gibench report laptop-run desktop-run quality-out --html --out both.html
    """
    from gibench.measure.runfolder.folder import write_atomically
    from gibench.report.loaded import QUALITY, load_quality, load_run
    from gibench.report.markdown import report as markdown
    from gibench.report.page import page

    folders = list(dict.fromkeys(runs))
    qualities = [load_quality(path) for path in folders if (path / QUALITY).exists()]
    loaded = [load_run(path) for path in folders if not (path / QUALITY).exists()]
    if not loaded:
        raise BadInput("no run to report", mend="give a folder that gibench run left as well")
    if html:
        text = page(loaded, qualities)
        target = out or loaded[0].path / "report.html"
    else:
        text = "\n".join(markdown(run.passes, run.frames, run.record) for run in loaded)
        if out is None:
            typer.echo(text, nl=False)
            return
        target = out
    if target.is_dir():
        raise BadInput("this is a folder", where=target, mend="give a file with --out")
    write_atomically(target, text.encode())
    typer.echo(str(target))
