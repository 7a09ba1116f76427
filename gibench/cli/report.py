"""``gibench report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


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
    from gibench.commands.report import make_report

    made = make_report(runs, html=html, out=out)
    if made.path is None:
        typer.echo(made.text, nl=False)
    else:
        typer.echo(str(made.path))
