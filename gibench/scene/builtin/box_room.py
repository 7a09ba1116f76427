"""A room of five walls, open at the front, with boxes on its floor."""

from __future__ import annotations

from gibench.scene.builtin.pieces import Piece, box, flat, footprint, panel
from gibench.scene.builtin.settings import Settings


def parts(settings: Settings) -> list[Piece]:
    """Walls edge to edge; the floor has a hole under each box, boxes have no bottom.

    The room stands on y = 0, centred on x = z = 0, open towards +z.
    """
    room, boxes = settings.geometry["room"], settings.geometry["boxes"]
    width, height, depth = room["size"]
    x, z, grid = width / 2, depth / 2, room["grid"]
    outline = [(-x, -z), (x, -z), (x, z), (-x, z)]
    holes = [footprint(b["size"], b["center"], b["turn_degrees"]) for b in boxes]
    made = [
        flat("floor", "floor", outline, holes),
        panel(
            "ceiling",
            "ceiling",
            (-x, height, -z),
            (width, 0, 0),
            (0, 0, depth),
            tuple(grid["ceiling"]),
        ),
        panel("back", "back", (-x, 0, -z), (width, 0, 0), (0, height, 0), tuple(grid["back"])),
        panel("left", "left", (-x, 0, z), (0, 0, -depth), (0, height, 0), tuple(grid["left"])),
        panel("right", "right", (x, 0, -z), (0, 0, depth), (0, height, 0), tuple(grid["right"])),
    ]
    for b in boxes:
        offset = (b["center"][0], 0.0, b["center"][1])
        sides = box(b["name"], b["name"], b["size"])
        made += [side.moved(offset, b["turn_degrees"]) for side in sides]
    return made


def glossy_strips(settings: Settings) -> list[Piece]:
    """The room with the floor in strips along its depth, a material each, and no boxes."""
    width, _, depth = settings.geometry["room"]["size"]
    names = settings.geometry["strips"]["materials"]
    across = width / len(names)
    strips = [
        panel(name, name, (-width / 2 + i * across, 0, depth / 2), (across, 0, 0), (0, 0, -depth))
        for i, name in enumerate(names)
    ]
    return strips + [piece for piece in parts(settings) if piece.name != "floor"]
