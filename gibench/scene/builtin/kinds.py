"""Six kinds of scene that defaults must suit, generated from their parameters.

A deep church, a maze of corridors, a street under the sky, a house with thin walls, a huge hall
with a small lamp, one object under a sky. None says how many probes it wants.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from gibench.scene.builtin.blocks import AIR, Blocks, lines
from gibench.scene.builtin.pieces import Piece
from gibench.scene.builtin.settings import Settings
from gibench.scene.builtin.shapes import lathe


def church(settings: Settings) -> list[Piece]:
    """A nave between two aisles, piers between them, windows low and high in each bay."""
    g = settings.geometry["church"]
    bays, bay, pier, wall = int(g["bays"]), g["bay"], g["pier"], g["wall"]
    nave, aisle, window = g["nave"], g["aisle"], g["window"]
    side = (bay - pier - window) / 2
    x = lines(wall, *[pier, side, window, side] * bays, pier, wall)
    z = lines(wall, aisle, pier, nave, pier, aisle, wall)
    y = [-wall, 0.0, *g["low_window"], g["aisle_height"], *g["high_window"], g["height"]]
    top, roof = g["height"] + wall, g["aisle_height"] + wall
    made = Blocks.of((x, [*y, roof, top], z), ("stone", "floor", "vault"))
    x0, x1, length = wall, x[-2], x[-1]
    # All stone, then the room, then what stands in it, then the windows.
    made.fill((0, -wall, 0), (length, top, z[-1]), "stone")
    made.fill((x0, 0, z[1]), (x1, g["aisle_height"], z[-2]), AIR)
    made.fill((x0, 0, z[3]), (x1, g["height"], z[4]), AIR)
    made.fill((0, -wall, 0), (length, 0, z[-1]), "floor")
    made.fill((x0, g["height"], z[3]), (x1, top, z[4]), "vault")
    for i in range(bays + 1):
        begin = wall + i * bay
        for rows in ((z[2], z[3]), (z[4], z[5])):
            made.fill((begin, 0, rows[0]), (begin + pier, g["aisle_height"], rows[1]), "stone")
    low, high = g["low_window"], g["high_window"]
    for i in range(bays):
        begin = wall + i * bay + pier + side
        for rows in ((0, z[1]), (z[-2], z[-1])):
            made.fill((begin, low[0], rows[0]), (begin + window, low[1], rows[1]), AIR)
        for rows in ((z[2], z[3]), (z[4], z[5])):
            made.fill((begin, high[0], rows[0]), (begin + window, high[1], rows[1]), AIR)
    # Above the aisles' roofs, which the high windows look down on, is the sky.
    for rows in ((0, z[2]), (z[5], z[-1])):
        made.fill((0, roof, rows[0]), (length, top, rows[1]), AIR)
    return made.pieces()


def maze(settings: Settings) -> list[Piece]:
    """Corridors of one width on a square lattice, walls of real thickness, no way out."""
    g = settings.geometry["maze"]
    columns, rows = int(g["size"][0]), int(g["size"][1])
    wide, wall, height = g["corridor"], g["wall"], g["height"]
    x = lines(*[wall, wide] * columns, wall)
    z = lines(*[wall, wide] * rows, wall)
    made = Blocks.of((x, [-wall, 0.0, height, height + wall], z), ("wall", "floor", "ceiling"))
    made.fill((0, -wall, 0), (x[-1], 0, z[-1]), "floor")
    made.fill((0, 0, 0), (x[-1], height, z[-1]), "wall")
    made.fill((0, height, 0), (x[-1], height + wall, z[-1]), "ceiling")
    pitch = wide + wall
    for (i, k), (j, m) in _passages(columns, rows, int(g["seed"]), float(g["loops"])):
        low = (wall + min(i, j) * pitch, 0, wall + min(k, m) * pitch)
        high = (wall + max(i, j) * pitch + wide, height, wall + max(k, m) * pitch + wide)
        made.fill(low, high, AIR)
    return made.pieces()


Cell = tuple[int, int]


def _passages(columns: int, rows: int, seed: int, loops: float) -> list[tuple[Cell, Cell]]:
    """Neighbours that are connected: a spanning tree by depth first search, and some more."""
    rng = np.random.default_rng(seed)

    def beside(cell: Cell) -> list[Cell]:
        i, k = cell
        near = [(i - 1, k), (i + 1, k), (i, k - 1), (i, k + 1)]
        return [(a, b) for a, b in near if 0 <= a < columns and 0 <= b < rows]

    found: list[tuple[Cell, Cell]] = []
    way, seen = [(0, 0)], {(0, 0)}
    while way:
        free = [cell for cell in beside(way[-1]) if cell not in seen]
        if not free:
            way.pop()
            continue
        following = free[int(rng.integers(len(free)))]
        found.append((way[-1], following))
        seen.add(following)
        way.append(following)
    for cell in itertools.product(range(columns), range(rows)):
        for other in beside(cell):
            new = cell < other and (cell, other) not in found and (other, cell) not in found
            if new and rng.random() < loops:
                found.append((cell, other))
    return found


def street(settings: Settings) -> list[Piece]:
    """Two rows of houses of different heights and widths along a street."""
    g = settings.geometry["street"]
    rng = np.random.default_rng(int(g["seed"]))
    wide, deep, walk = g["road"], g["house_depth"], g["margin"]
    houses = []
    for row in (0, 1):
        x = walk
        for _ in range(int(g["houses"])):
            across, high = rng.uniform(*g["house_width"]), rng.uniform(*g["house_height"])
            houses.append((row, x, x + across, high))
            x += across + rng.choice([0.0, g["gap"]])
    length = max(h[2] for h in houses) + walk
    z = lines(walk, deep, wide, deep, walk)
    y = [-1.0, 0.0, *sorted(h[3] for h in houses), max(h[3] for h in houses) + 1.0]
    cuts = [0.0, length, *(e for h in houses for e in h[1:3])]
    colors = ("render", "brick", "stone")
    made = Blocks.of((cuts, y, z), ("ground", *colors))
    made.fill((0, -1, 0), (length, 0, z[-1]), "ground")
    for n, (row, begin, end, high) in enumerate(houses):
        across = (z[1], z[2]) if row == 0 else (z[3], z[4])
        made.fill((begin, 0, across[0]), (end, high, across[1]), colors[n % len(colors)])
    return made.pieces()


def thin_house(settings: Settings) -> list[Piece]:
    """Rooms in a row of two and two storeys, every wall and slab a few centimetres thick."""
    g = settings.geometry["house"]
    wall, room, height, yard = g["wall"], g["room"], g["height"], g["yard"]
    door, sill, lintel, window = g["door"], g["sill"], g["lintel"], g["window"]
    edge = (room - window) / 2
    door_edge = (room - door) / 2
    rooms: list[float] = []
    for i in range(2):
        begin = yard + wall + i * (room + wall)
        rooms += [begin, begin + edge, begin + edge + window, begin + room]
        rooms += [begin + door_edge, begin + door_edge + door]
    far = 2 * yard + 3 * wall + 2 * room
    plan = [0.0, yard, *rooms, far - yard, far]
    y = [-wall, 0.0]
    floors = [0.0, height + wall]
    for base in floors:
        y += [base + sill, base + lintel, base + height, base + height + wall]
    roof = floors[-1] + height + wall
    made = Blocks.of((plan, [*y, roof + 1.0], plan), ("ground", "wall", "boards"))
    made.fill((0, -wall, 0), (far, 0, far), "ground")
    made.fill((yard, 0, yard), (far - yard, roof, far - yard), "wall")
    for base in floors:
        for i, k in itertools.product(range(2), range(2)):
            x, z = (yard + wall + n * (room + wall) for n in (i, k))
            made.fill((x, base, z), (x + room, base + height, z + room), AIR)
            _openings(made, (x, base, z), (i, k), g)
    made.fill((yard, height, yard), (far - yard, height + wall, far - yard), "boards")
    return made.pieces()


def _openings(
    made: Blocks, corner: Sequence[float], at: tuple[int, int], g: dict[str, float]
) -> None:
    """A window to the outside along x, and a door to the room beside along z."""
    wall, room = g["wall"], g["room"]
    edge, door_edge = (room - g["window"]) / 2, (room - g["door"]) / 2
    x, base, z = corner
    outer = (x - wall, x) if at[0] == 0 else (x + room, x + room + wall)
    made.fill(
        (outer[0], base + g["sill"], z + edge),
        (outer[1], base + g["lintel"], z + edge + g["window"]),
        AIR,
    )
    if at[1] == 0:
        made.fill(
            (x + door_edge, base, z + room),
            (x + door_edge + g["door"], base + g["lintel"], z + room + wall),
            AIR,
        )


def big_hall(settings: Settings) -> list[Piece]:
    """A closed hall with pillars and one small lamp that glows on all sides."""
    g = settings.geometry["hall"]
    long, high, wide = g["size"]
    lamp, pillar, count = g["lamp"], g["pillar"], int(g["pillars"])
    mid, above = (long / 2, g["lamp_height"], wide / 2), 1.0
    places = [(i + 0.5) * long / count for i in range(count)]
    spots = [(x, z) for x in places for z in (wide / 4, 3 * wide / 4)]
    half = pillar / 2
    x = [-above, 0, long, long + above, *(p + s for p in places for s in (-half, half))]
    z = [-above, 0, wide, wide + above]
    z += [c + s for c in (wide / 4, 3 * wide / 4) for s in (-half, half)]
    y = [-above, 0, high, high + above]
    cuts = [[*axis, m - lamp / 2, m + lamp / 2] for axis, m in zip((x, y, z), mid, strict=True)]
    made = Blocks.of(cuts, ("wall", "floor", "ceiling", "lamp"))
    made.fill((-above, -above, -above), (long + above, high + above, wide + above), "wall")
    made.fill((0, -above, 0), (long, 0, wide), "floor")
    made.fill((0, high, 0), (long, high + above, wide), "ceiling")
    made.fill((0, 0, 0), (long, high, wide), AIR)
    for px, pz in spots:
        made.fill((px - half, 0, pz - half), (px + half, high, pz + half), "wall")
    made.fill([m - lamp / 2 for m in mid], [m + lamp / 2 for m in mid], "lamp")
    return made.pieces()


def one_object(settings: Settings) -> list[Piece]:
    """A turned vase, closed, with nothing around it."""
    g = settings.geometry["object"]
    return lathe("vase", "clay", g["profile"], int(g["segments"]))
