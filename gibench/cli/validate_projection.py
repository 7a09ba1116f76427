"""``gibench validate-projection``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gibench.cli import options


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
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Folder for validation.csv, rows.csv and best.csv; nothing is written by default.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    cache_dir: options.CacheDir = None,
    quiet: options.Quiet = False,
) -> None:
    """Hold projections against times that others measured on GPUs.

    Predictions were frozen with their hash before they were scored. Prints how many rows lie inside
    their range, how wide ranges are, how far off nominal times, and whether verdicts called sure
    were right. With --predict it makes predictions, which needs the extra 'project'.

    Example:

      gibench validate-projection
    """
    from gibench.commands.validate_projection import predict_validation
    from gibench.commands.validate_projection import validate_projection as validate
    from gibench.report.validation import show_validation

    if predict is not None:
        tell = (lambda _: None) if quiet else (lambda text: typer.echo(text, err=True))
        table = predict_validation(predict, cache_dir, tell)
        typer.echo(f"{len(table)} predictions are frozen in {predict}")
        return
    result = validate(predictions, out)
    if not quiet:
        show_validation(result.summary, result.best, result.hashes)
