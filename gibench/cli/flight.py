"""The options of the camera's flight."""

from __future__ import annotations

from typing import Annotated

import typer

from gibench.cli.options import OUTPUT

CameraPathChoice = Annotated[
    str,
    typer.Option(
        "--camera-path",
        metavar="rest|flight|around|FILE",
        help="What the camera of every technique does: rest; flight, a round "
        "through the scene and back to rest; around, one around its outside; or a TOML file of "
        "positions and targets. Without "
        "--frames, the whole flight is measured.",
        rich_help_panel=OUTPUT,
    ),
]
RestFrames = Annotated[
    int,
    typer.Option(
        "--rest-frames",
        min=0,
        metavar="N",
        help="Frames, warm-up included, before the flight.",
        rich_help_panel=OUTPUT,
    ),
]
FlightFrames = Annotated[
    int,
    typer.Option(
        "--flight-frames",
        min=1,
        metavar="N",
        help="Frames that the flight takes.",
        rich_help_panel=OUTPUT,
    ),
]
