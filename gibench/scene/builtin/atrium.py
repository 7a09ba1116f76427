"""A colonnaded court of two storeys under an open sky, in the manner of Sponza.

A rectangular court is surrounded on both storeys by arcades: columns carry arched walls, and those
carry slabs. Every surface ends where it meets another: floors have holes under columns, ceilings
over walls, abaci under arches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibench.arrays import Doubles
from gibench.scene.builtin.arcade import (
    Arcade,
    Storey,
    abacus_half,
    arcade_wall,
    column,
    pier,
    plinth_half,
)
from gibench.scene.builtin.pieces import (
    Piece,
    circle,
    flat,
    panel,
    shifted,
)
from gibench.scene.builtin.settings import Settings
from gibench.scene.builtin.shapes import curtain, curve, handrail, lathe, pieces_of, rim

Ring = Doubles


@dataclass(frozen=True)
class Plan:
    """The ground plan, metres.

    Attributes:
        arcade: what bays, walls and columns measure.
        bays: number of bays along x and along z.
        gallery: clear depth of the arcades.
        overhang: how far the slabs stand into the court from the walls.
        slab: thickness of the slabs.
        lower: the ground storey.
        upper: the upper storey.
        parapet: height of the wall around the roof's edge.
    """

    arcade: Arcade
    bays: tuple[int, int]
    gallery: float
    overhang: float
    slab: float
    lower: Storey
    upper: Storey
    parapet: float

    @property
    def axis(self) -> tuple[float, float]:
        """Half the distance between opposite arcade walls' middles, along x and z."""
        pier_half = self.arcade.pier_half
        x, z = (n * self.arcade.bay / 2 + pier_half for n in self.bays)
        return x, z

    @property
    def outer(self) -> tuple[float, float]:
        """Half the size of the whole building."""
        x, z = (a + self.arcade.thickness / 2 + self.gallery for a in self.axis)
        return x, z

    @property
    def court(self) -> tuple[float, float]:
        """Half the size of the opening in the slabs."""
        x, z = (a - self.arcade.thickness / 2 - self.overhang for a in self.axis)
        return x, z


def parts(settings: Settings) -> list[Piece]:
    """All of the court, from the parameters in its settings."""
    g = settings.geometry
    upper_floor = g["ground_height"] + g["slab"]
    plan = Plan(
        arcade=Arcade(**g["arcade"]),
        bays=(int(g["bays"][0]), int(g["bays"][1])),
        gallery=g["gallery"],
        overhang=g["overhang"],
        slab=g["slab"],
        lower=Storey("lower", 0.0, g["ground_spring"], g["ground_height"]),
        upper=Storey(
            "upper", upper_floor, upper_floor + g["upper_spring"], upper_floor + g["upper_height"]
        ),
        parapet=g["parapet"],
    )
    bodies, feet = _urns(plan)
    made = [*bodies, *_shell(plan, feet), *_curtains(plan, g["curtain_grid"])]
    for storey in (plan.lower, plan.upper):
        made += _colonnade(plan, storey)
    return made + _railings(plan)[0]


def _rectangle_ring(half: tuple[float, float]) -> Ring:
    x, z = half
    return np.array([(-x, -z), (x, -z), (x, z), (-x, z)])


def _square(half: float, center: tuple[float, float]) -> Ring:
    """A square (4, 2) in (x, -z) about ``center`` (x, z)."""
    return shifted(_rectangle_ring((half, half)), center[0], -center[1])


def _places(plan: Plan) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Where columns and piers stand, (x, z)."""
    ax, az = plan.axis
    bay = plan.arcade.bay
    xs = [(i - plan.bays[0] / 2) * bay for i in range(1, plan.bays[0])]
    zs = [(i - plan.bays[1] / 2) * bay for i in range(1, plan.bays[1])]
    columns = [(x, s * az) for s in (-1, 1) for x in xs] + [
        (s * ax, z) for s in (-1, 1) for z in zs
    ]
    return columns, [(sx * ax, sz * az) for sx in (-1, 1) for sz in (-1, 1)]


def _wall_rings(plan: Plan) -> tuple[Ring, Ring]:
    """Outline of what stands on the court's edge (walls and piers), court side and outer side."""
    ax, az = plan.axis
    t, p = plan.arcade.thickness / 2, plan.arcade.pier_half
    inner = [(ax - t, az - p), (ax - p, az - p), (ax - p, az - t)]
    outer = [
        (ax + t, az - p),
        (ax + p, az - p),
        (ax + p, az + p),
        (ax - p, az + p),
        (ax - p, az + t),
    ]
    return _mirrored(inner), _mirrored(outer)


def _mirrored(quarter: list[tuple[float, float]]) -> Ring:
    """A ring symmetric about both axes from its first quarter, counter-clockwise."""
    q = np.array(quarter)
    return np.concatenate([q, q[::-1] * [-1, 1], -q, q[::-1] * [1, -1]])


def _shell(plan: Plan, feet: list[Ring]) -> list[Piece]:
    """Floors, ceilings, outer walls, roof and the mouldings of the slabs."""
    columns, piers = _places(plan)
    plinths = [_square(plinth_half(plan.arcade), c) for c in columns]
    pillars = [_square(plan.arcade.pier_half, c) for c in piers]
    outer, court = _rectangle_ring(plan.outer), _rectangle_ring(plan.court)
    inner_ring, outer_ring = _wall_rings(plan)
    made = [flat("floor", "floor", outer, [*plinths, *pillars, *feet], metres_per_uv=2.0)]
    for storey in (plan.lower, plan.upper):
        # Seen from below, v is +z; all these rings are symmetric.
        name, at, v = f"{storey.name} ceiling", (0.0, storey.top, 0.0), (0.0, 0.0, 1.0)
        made.append(flat(name, "plaster", outer, [outer_ring], origin=at, v=v))
        made.append(flat(name, "stone", inner_ring, [court], origin=at, v=v))
        made += _walls(plan, storey)
    x, z = plan.court
    y, s = plan.lower.top, plan.slab
    moulding = [(0, y), (0.05, y + s * 0.25), (0.05, y + s * 0.75), (0, y + s)]
    made += rim("gallery", "stone", (x, z), moulding)
    posts = _railings(plan)[1]
    made.append(
        flat(
            "gallery",
            "gallery floor",
            outer,
            [court, *plinths, *pillars, *posts],
            origin=(0.0, plan.upper.floor, 0.0),
            metres_per_uv=2.0,
        )
    )
    y = plan.upper.top
    roof = y + s
    edge = [
        (0, y), (0.12, y + s * 0.3), (0.12, y + s * 0.8), (0, y + s),
        (0, roof + plan.parapet), (-0.3, roof + plan.parapet), (-0.3, roof),
    ]  # fmt: skip
    made += rim("roof", "stone", (x, z), edge)
    hole = _rectangle_ring((x + 0.3, z + 0.3))
    made.append(flat("roof", "roof", outer, [hole], origin=(0.0, roof, 0.0)))
    return made


def _walls(plan: Plan, storey: Storey) -> list[Piece]:
    x, z = plan.outer
    y, height = storey.floor, storey.top - storey.floor
    sides = [
        ((-x, y, -z), (2 * x, 0, 0)), ((x, y, -z), (0, 0, 2 * z)),
        ((x, y, z), (-2 * x, 0, 0)), ((-x, y, z), (0, 0, -2 * z)),
    ]  # fmt: skip
    return [
        panel(
            f"{storey.name} wall {i}",
            "bricks",
            origin,
            along,
            (0, height, 0),
            (8, 2),
            metres_per_uv=1.2,
        )
        for i, (origin, along) in enumerate(sides)
    ]


def _colonnade(plan: Plan, storey: Storey) -> list[Piece]:
    """Columns, piers and arched walls of one storey."""
    columns, piers = _places(plan)
    made: list[Piece] = []
    model = column(plan.arcade, storey)
    ax, az = plan.axis
    for i, (x, z) in enumerate(columns):
        turn = 0.0 if abs(z) == az else 90.0
        made += [p.moved((x, 0, z), turn).named(f"{storey.name} column {i}") for p in model]
    for i, (x, z) in enumerate(piers):
        # The wall ends lie on the faces towards the court's middle along x and z.
        made += [
            p.moved((x, 0, z)).named(f"{storey.name} pier {i}")
            for p in pier(plan.arcade, storey, towards=(-np.sign(x), -np.sign(z)))
        ]
    long = arcade_wall(plan.arcade, storey, plan.bays[0])
    short = arcade_wall(plan.arcade, storey, plan.bays[1])
    # The model runs along +x with its court side towards +z.
    for name, model, offset, turn in (
        ("north", long, (0, 0, -az), 0.0),
        ("south", long, (0, 0, az), 180.0),
        ("west", short, (-ax, 0, 0), 90.0),
        ("east", short, (ax, 0, 0), -90.0),
    ):
        made += [p.moved(offset, turn).named(f"{storey.name} {name} arcade") for p in model]
    return made


def _curtains(plan: Plan, grid: list[int]) -> list[Piece]:
    """Cloths hung in the bays of the long sides: drapes below, banners above."""
    az, bay = plan.axis[1], plan.arcade.bay
    clear = bay - 2 * abacus_half(plan.arcade)
    colors = ("red cloth", "green cloth", "blue cloth")
    made: list[Piece] = []
    for side, z in (("north", -az), ("south", az)):
        for i in range(plan.bays[0]):
            x = (i + 0.5 - plan.bays[0] / 2) * bay
            storey = plan.lower if i % 2 == 0 else plan.upper
            length = (storey.spring - storey.floor) * (0.72 if i % 2 == 0 else 0.55)
            name = f"{side} curtain {i}"
            cloth = curtain(
                name, colors[(i + (side == "south")) % 3], size=(clear * 0.88, length),
                folds=3.5 + (i % 3), depth=0.09, grid=(int(grid[0]), int(grid[1])),
            )  # fmt: skip
            made += [p.moved((x, storey.spring - 0.08 - length, z)) for p in cloth]
    return made


def _railings(plan: Plan) -> tuple[list[Piece], list[Ring]]:
    """Balustrades of the gallery between the columns, and the feet their balusters need."""
    made: list[Piece] = []
    feet: list[Ring] = []
    y, height, segments = plan.upper.floor, 0.85, 10
    profile = curve(
        [(0.05, 0.06), (0.075, 0.17), (0.05, 0.33), (0.035, 0.5), (0.06, 0.72), (0.045, height)], 8
    )
    profile = np.concatenate([[(0.05, 0.0)], profile])
    ax, az = plan.axis
    gap = plinth_half(plan.arcade) + 0.06
    for across, count, level in ((az, plan.bays[0], "x"), (ax, plan.bays[1], "z")):
        for side in (-1, 1):
            for i in range(count):
                middle = (i + 0.5 - count / 2) * plan.arcade.bay
                half = plan.arcade.bay / 2 - gap
                steps = np.linspace(-half + 0.12, half - 0.12, 6) + middle
                spots = [(s, side * across) if level == "x" else (side * across, s) for s in steps]
                name = f"balustrade {level}{side:+d} {i}"
                for x, z in spots:
                    made += lathe(name, "stone", profile, segments, (x, y, z))
                    feet.append(circle(profile[0, 0], (x, -z), segments))
                tops = [circle(profile[-1, 0], (x, -z), segments) for x, z in spots]
                start = (middle - half, y + height, side * across)
                run = (2 * half, 0.0, 0.0)
                if level == "z":
                    start = (side * across, y + height, middle - half)
                    run = (0.0, 0.0, 2 * half)
                made += handrail(name, "stone", start, run, (0.2, 0.1), tops)
    return made, feet


def _urns(plan: Plan) -> tuple[list[Piece], list[Ring]]:
    """A fountain in the middle of the court and urns along its sides, and where they stand."""
    basin = [
        (1.25, 0.0), (1.25, 0.12), (1.15, 0.16), (1.12, 0.5), (1.22, 0.56), (1.22, 0.62),
        (1.02, 0.62), (0.98, 0.3), (0.2, 0.3), (0.16, 0.9), (0.2, 1.0), (0.55, 1.12), (0.6, 1.2),
        (0.5, 1.2), (0.1, 1.1), (0.08, 1.4), (0.12, 1.46), (0.0, 1.6),
    ]  # fmt: skip
    made: list[Piece] = []
    for piece in pieces_of(basin):
        made += lathe("fountain", "marble", curve(piece, 2 * len(piece)), 72)
    feet = [circle(1.25, segments=72)]
    body = curve(
        [(0.22, 0.0), (0.12, 0.14), (0.3, 0.42), (0.34, 0.62), (0.2, 0.82), (0.17, 0.9),
         (0.26, 1.0)], 20
    )  # fmt: skip
    inside = curve([(0.22, 1.0), (0.14, 0.9), (0.17, 0.82), (0.26, 0.65), (0.0, 0.5)], 10)
    lip = np.array([(0.26, 1.0), (0.22, 1.0)])
    bay = plan.arcade.bay
    for i, step in enumerate((-4, -2, 2, 4)):
        for side in (-1, 1):
            x, z = step * bay, side * plan.court[1] * 0.62
            name = f"urn {i} {'north' if side < 0 else 'south'}"
            for profile in (body, lip, inside):
                made += lathe(name, "terracotta", profile, 28, (x, 0.0, z))
            feet.append(circle(0.22, (x, -z), 28))
    return made, feet
