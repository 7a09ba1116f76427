"""The built-in scenes: small ones described in data files, large ones generated.

``scenes/builtin/NAME.toml`` holds a scene's settings: lights, environment, cameras, number of
receivers and mostly of probes, and the parameters of its geometry.
"""

from __future__ import annotations

from collections.abc import Callable

from gibench.errors import BadInput
from gibench.scene.builtin import atrium, box_room, hall, kinds, two_rooms
from gibench.scene.builtin.pieces import Piece
from gibench.scene.builtin.settings import Settings, assemble, read_settings
from gibench.scene.model import Scene

# Scene name -> function that makes its geometry from its settings.
_MAKERS: dict[str, Callable[[Settings], list[Piece]]] = {
    "cornell-box": box_room.parts,
    "blue-orange-box": box_room.parts,
    "bumpy-box": box_room.parts,
    "glossy-box": box_room.glossy_strips,
    "sharp-bounce": box_room.parts,
    "two-rooms": two_rooms.parts,
    "two-rooms-gap": two_rooms.parts,
    "hall": hall.parts,
    "atrium": atrium.parts,
    "hall-door": hall.parts_with_door,
    "church": kinds.church,
    "maze": kinds.maze,
    "street": kinds.street,
    "thin-house": kinds.thin_house,
    "big-hall": kinds.big_hall,
    "vase": kinds.one_object,
}


def names() -> list[str]:
    """The names of the built-in scenes: simplest first, then the kinds that defaults must suit."""
    return list(_MAKERS)


def moving_names() -> list[str]:
    """Those of them whose objects have motions."""
    return [name for name in names() if read_settings(name).motions]


def build(name: str) -> Scene:
    """The built-in scene called ``name``; the same one, bit for bit, every time.

    Raises:
        BadInput: there is no such scene.
    """
    if name not in _MAKERS:
        raise BadInput(
            "no built-in scene has this name", where=name, mend=f"use one of {', '.join(names())}"
        )
    settings = read_settings(name)
    return assemble(settings, _MAKERS[name](settings))
