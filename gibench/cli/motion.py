"""The option that lets objects move and materials change."""

from __future__ import annotations

from typing import Annotated

import typer

from gibench.cli.options import OUTPUT

MotionChoice = Annotated[
    str,
    typer.Option(
        "--motion",
        metavar="rest|scene|FILE",
        help="What the scene's objects and materials do: rest; move and change as the scene "
        "describes (its [[motion]] tables; of the built-in ones, hall, hall-door and atrium); or "
        "as a TOML file with such tables does. The tree is refitted every frame.",
        rich_help_panel=OUTPUT,
    ),
]
