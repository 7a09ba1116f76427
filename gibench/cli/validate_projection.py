"""``gibench validate-projection``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gibench.cli import options

_NONE: list[Path] = []


def validate_projection(
    predictions: Annotated[
        Path | None,
        typer.Option(
            "--predictions",
            metavar="DIR",
            help="Frozen predictions to score; by default gibench's own.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    predict: Annotated[
        Path | None,
        typer.Option(
            "--predict",
            metavar="DIR",
            help="Make predictions anew and freeze them there instead; takes half an hour.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        options.out_folder(
            "Folder for validation.csv, rows.csv and best.csv, or orders.csv and passes.csv; "
            "nothing is written by default."
        ),
    ] = None,
    here: Annotated[
        list[Path],
        typer.Option(
            "--here",
            metavar="RUN",
            help="Instead hold this run's measured passes against its projection onto the device "
            "that ran it (gibench project RUN -d PROFILE): orders only. Repeat it for several.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = _NONE,
    cache_dir: options.CacheDir = None,
    quiet: options.Quiet = False,
) -> None:
    """Hold projections against times that others measured on GPUs.

    Predictions were frozen with their hash before they were scored. Prints how many rows lie inside
    their range, how wide ranges are, how far off nominal times, and whether verdicts called sure
    were right. With --predict it makes predictions, which needs the extra 'project'.

    With --here it says how well a projection keeps the order of passes that were measured on this
    machine: no evidence for GPUs, but a model that is wrong by orders of magnitude is found.

    Examples:

      gibench validate-projection

      gibench validate-projection --here results/runs/mine
    """
    from gibench.commands.validate_projection import check_orders, predict_validation
    from gibench.commands.validate_projection import validate_projection as validate
    from gibench.report.validation import show_orders, show_validation

    if predict is not None:
        tell = (lambda _: None) if quiet else (lambda text: typer.echo(text, err=True))
        table = predict_validation(predict, cache_dir, tell)
        typer.echo(f"{len(table)} predictions are frozen in {predict}")
        return
    if here:
        table, _ = check_orders(here, out)
        if not quiet:
            show_orders(table)
        return
    result = validate(predictions, out)
    if not quiet:
        show_validation(result.summary, result.best, result.hashes)
