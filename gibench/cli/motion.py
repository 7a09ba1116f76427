"""The option that lets objects move."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from gibench.cli.options import OUTPUT

if TYPE_CHECKING:
    from gibench.techniques.object_motion import MotionOptions

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


def motion(path: str) -> MotionOptions:
    """The motion asked for.

    Raises:
        BadInput: its file holds none.
    """
    from pathlib import Path

    from gibench.scene.motion.file import load_motions
    from gibench.techniques.object_motion import REST, SCENE, MotionOptions

    if path not in (REST, SCENE):
        load_motions(Path(path))
    return MotionOptions(path)
