"""The option that lets objects move."""

from __future__ import annotations

from typing import Annotated

import typer

from gibench.cli.options import OUTPUT

MotionChoice = Annotated[
    str,
    typer.Option(
        "--motion",
        metavar="rest|scene|FILE",
        help="What the scene's objects do: rest; move as the scene describes "
        "(its [[motion]] tables; of the built-in ones, hall and atrium); or as a TOML file with "
        "such tables does. The tree is refitted every frame. For direct, ddgi and gibs.",
        rich_help_panel=OUTPUT,
    ),
]
RestOnly = Annotated[str, typer.Option("--motion", hidden=True)]
