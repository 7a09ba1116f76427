"""``gibench project``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gibench.cli import options
from gibench.errors import printable


def project(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.")],
    device_profile: options.ProjectedOn,
    cache_dir: options.CacheDir = None,
    quiet: options.Quiet = False,
) -> None:
    """Say how long a run's passes would take on devices that are not here, as ranges.

    Traces the launches of one frame of every configuration (kept in the cache, so once), and puts
    what they do to memory through a model of each device at every value that its figures may have.
    Writes projected.csv into the run's folder, and ratios.csv: how many times as long as the
    cheapest each configuration takes. Nothing of it is measured. Needs the extra 'project'.

    Example:

      gibench project results/runs/20260101T120000Z-iphone7 -d titan-x-pascal -d iphone7
    """
    from gibench.commands.project import project as projected
    from gibench.report.projected_terminal import show_projection, show_ratios

    tell = (lambda _: None) if quiet else (lambda text: typer.echo(text, err=True))
    result = projected(run, device_profile, cache_dir, tell)
    if not quiet:
        show_projection(result.table)
        show_ratios(result.ratios)
        typer.echo(f"see {printable(str(result.folder / 'projected.csv'))}")
