"""``gibench calibrate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gibench.cli import options
from gibench.errors import GibenchError


def calibrate(
    profile: options.Profile,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="Write the calibrated profile here.",
            rich_help_panel=options.OUTPUT,
        ),
    ],
    device: options.DeviceNumber = None,
    quiet: options.Quiet = False,
) -> None:
    """Measure a device's own machine part, so that times projected onto it have narrower ranges.

    Bandwidth, clock, latencies and the cost of a launch, by microbenchmarks alone, in about a
    minute; nothing else may compute meanwhile. The profile must be that of the device: it gives the
    sizes of caches and the number of units, which are not measured.

    Example:

      gibench calibrate -d titan-x-pascal -o mine.toml
    """
    from gibench.commands.calibrate import calibrate as measure

    tell = (lambda _: None) if quiet else (lambda text: typer.echo(text, err=True))
    result = measure(profile, device, tell)
    try:
        out.write_text(result.toml, encoding="utf-8")
    except OSError as error:
        raise GibenchError(f"cannot be written ({error.strerror})", where=out) from error
    if not quiet:
        from gibench.report.calibration import show_calibration

        show_calibration(result.figures, out)
