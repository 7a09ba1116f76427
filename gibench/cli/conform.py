"""``gibench conform``."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import Annotated

import typer

from gibench.cli import options
from gibench.errors import GibenchError


def conform(
    device: options.DeviceNumber = None,
    seed: options.Seed = 0,
    time_limit: Annotated[
        float,
        typer.Option(
            "--time-limit",
            min=1.0,
            metavar="SECONDS",
            help="After which a case that has not answered counts as wrong.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = 120.0,
    kernels: Annotated[
        Path | None,
        typer.Option(
            "--kernels",
            metavar="DIR",
            help="Another kernel tree than the installed one.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    json: Annotated[
        Path | None,
        typer.Option(
            "--json",
            metavar="FILE",
            help="Write the device's facts and every kernel's result, to share; - for standard "
            "output.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    quiet: options.Quiet = False,
) -> None:
    """Compare every kernel with an independent float64 result, on any OpenCL device.

    Kernels run on small random inputs at several work-group sizes, in processes of their own: one
    that hangs, crashes or does not build stops no other. Status: right; wrong; cannot run, with the
    reason; no oracle, for kernels that are not compared with anything yet.

    Exit code 1: some kernel is wrong or does not build.

    Examples:

      gibench conform

      gibench conform --device 1 --json conform.json
    """
    from gibench.commands.conform import conform as compare

    result = compare(device, seed, time_limit, kernels)
    if json is not None:
        text = json_module.dumps(result.record, indent=2, ensure_ascii=False)
        if json == Path("-"):
            typer.echo(text)
        else:
            try:
                json.write_text(text + "\n", encoding="utf-8")
            except OSError as error:
                raise GibenchError(f"cannot be written ({error.strerror})", where=json) from error
    if not quiet and json != Path("-"):
        from gibench.report.conformance import show_conformance

        show_conformance(result.kernels, result.record)
    if result.error is not None:
        raise result.error
