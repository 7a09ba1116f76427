"""Two closed rooms beside each other, a wall of real thickness between them."""

from __future__ import annotations

from gibench.scene.builtin.pieces import Piece, box, flat, footprint, panel
from gibench.scene.builtin.settings import Settings


def parts(settings: Settings) -> list[Piece]:
    """The room on the left first; each has a box on its floor.

    The rooms stand on y = 0, mirrored about x = 0, their long sides along z. The wall between them
    is what lies between their inner faces: nothing is seen of it but these.
    """
    rooms = settings.geometry["rooms"]
    width, height, depth = rooms["size"]
    middle = (width + rooms["wall"]) / 2
    made = []
    for name, x in (("lit", -middle), ("dark", middle)):
        made += [part.moved((x, 0, 0)) for part in _room(settings, name, width, height, depth)]
    return made


def _room(settings: Settings, name: str, width: float, height: float, depth: float) -> list[Piece]:
    x, z = width / 2, depth / 2
    inside = next(b for b in settings.geometry["boxes"] if b["room"] == name)
    size, center, turn = inside["size"], inside["center"], inside["turn_degrees"]
    outline = [(-x, -z), (x, -z), (x, z), (-x, z)]
    walls = (
        ("back", "wall", (-x, 0, -z), (width, 0, 0), (0, height, 0)),
        ("left", f"{name} left", (-x, 0, z), (0, 0, -depth), (0, height, 0)),
        ("right", f"{name} right", (x, 0, -z), (0, 0, depth), (0, height, 0)),
        ("front", "wall", (x, 0, z), (-width, 0, 0), (0, height, 0)),
        ("ceiling", "ceiling", (-x, height, -z), (width, 0, 0), (0, 0, depth)),
    )
    made = [flat(f"{name} floor", "floor", outline, [footprint(size, center, turn)])]
    made += [panel(f"{name} {wall}", *rest) for wall, *rest in walls]
    sides = box(f"{name} box", inside["name"], size)
    return made + [side.moved((center[0], 0.0, center[1]), turn) for side in sides]
