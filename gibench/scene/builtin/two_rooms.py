"""Two rooms beside each other, a wall of real thickness between them, whole or with a gap."""

from __future__ import annotations

from gibench.scene.builtin.pieces import Piece, box, flat, footprint, panel
from gibench.scene.builtin.settings import Settings


def parts(settings: Settings) -> list[Piece]:
    """The room on the left first; each has a box on its floor.

    The rooms stand on y = 0, mirrored about x = 0, their long sides along z. The wall between them
    is what lies between their inner faces: nothing is seen of it but these. Where it has a ``gap``,
    it ends so far short of the front, from floor to ceiling.
    """
    rooms = settings.geometry["rooms"]
    width, height, depth = rooms["size"]
    gap = rooms.get("gap", 0.0)
    middle = (width + rooms["wall"]) / 2
    made = []
    for name, x in (("lit", -middle), ("dark", middle)):
        made += [part.moved((x, 0, 0)) for part in _room(settings, name, width, height, depth, gap)]
    return made + (_passage(rooms["wall"], height, depth, gap) if gap else [])


def _passage(wall: float, height: float, depth: float, gap: float) -> list[Piece]:
    """What is seen in the gap: the wall's end; floor, ceiling and front as far as it is thick."""
    x, front = wall / 2, depth / 2
    end = front - gap
    across, up, along = (wall, 0, 0), (0, height, 0), (0, 0, gap)
    return [
        panel("passage end", "wall", (-x, 0, end), across, up),
        panel("passage front", "wall", (x, 0, front), (-wall, 0, 0), up),
        panel("passage floor", "floor", (-x, 0, end), along, across),
        panel("passage ceiling", "ceiling", (-x, height, end), across, along),
    ]


def _room(
    settings: Settings, name: str, width: float, height: float, depth: float, gap: float
) -> list[Piece]:
    x, z = width / 2, depth / 2
    inside = next(b for b in settings.geometry["boxes"] if b["room"] == name)
    size, center, turn = inside["size"], inside["center"], inside["turn_degrees"]
    outline = [(-x, -z), (x, -z), (x, z), (-x, z)]
    # The lit room's right wall and the dark room's left one stand between the rooms.
    left, right = (depth, depth - gap) if name == "lit" else (depth - gap, depth)
    walls = (
        ("back", "wall", (-x, 0, -z), (width, 0, 0), (0, height, 0)),
        ("left", f"{name} left", (-x, 0, left - z), (0, 0, -left), (0, height, 0)),
        ("right", f"{name} right", (x, 0, -z), (0, 0, right), (0, height, 0)),
        ("front", "wall", (x, 0, z), (-width, 0, 0), (0, height, 0)),
        ("ceiling", "ceiling", (-x, height, -z), (width, 0, 0), (0, 0, depth)),
    )
    made = [flat(f"{name} floor", "floor", outline, [footprint(size, center, turn)])]
    made += [panel(f"{name} {wall}", *rest) for wall, *rest in walls]
    sides = box(f"{name} box", inside["name"], size)
    return made + [side.moved((center[0], 0.0, center[1]), turn) for side in sides]
