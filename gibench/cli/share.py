"""``gibench submit`` and ``gibench gallery``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def submit(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The run's folder.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="By default RUN.gibench beside it."),
    ] = None,
    conform: Annotated[
        Path | None,
        typer.Option(
            "--conform", metavar="FILE", help="What 'gibench conform' found on this device."
        ),
    ] = None,
) -> None:
    """Pack a run into one file for others; nothing is sent.

    The file holds the environment, roofs and samples, and no user, host or path. It is a ZIP: look
    into it before you share it.

    Example:

      gibench submit results/runs/20260101T120000Z-iphone7
    """
    from gibench.commands.share import submit as submit_run

    typer.echo(str(submit_run(run, out, conform)))


def gallery(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="What 'gibench submit' wrote.")
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="The page to write.")
    ] = Path("gallery.html"),
) -> None:
    """Make one page of many machines' runs: which technique wins where. It needs no network.

    Example:

      gibench gallery laptop.gibench desktop.gibench --out gallery.html
    """
    from gibench.commands.share import make_gallery

    typer.echo(str(make_gallery(files, out)))
