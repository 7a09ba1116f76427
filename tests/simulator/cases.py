"""What is run under Oclgrind: one case is one fork of its process (forks.py).

Every variant runs with every work-group size and with every choice of settings, but not with every
pair of the two: those are ``SLOW``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from gibench.device import SIMT
from gibench.techniques.registry import TUNED, techniques

# Work-group size and floats per vector: even, odd (a last group that is not full), scalar.
SIZES = ((16, 16), (7, 4), (64, 1))


@dataclass(frozen=True)
class Case:
    """Something to run.

    Attributes:
        what: a function of run_case.py.
        size: work-items per group; the bake's kernels have their own, of one.
        width: floats per vector.
        technique: for ``bake``, ``frames``, ``moving`` and ``changing``.
        variant: for ``frames``, ``moving`` and ``changing``.
        settings: of the technique, beside run_case.SMALL.
        layout: of a variant that is tuned.
    """

    what: str
    size: int
    width: int
    technique: str = ""
    variant: str = ""
    settings: dict[str, Any] = field(default_factory=dict)
    layout: str = "wide"

    def __str__(self) -> str:
        settings = [f"{k}={v}" for k, v in self.settings.items()]
        layout = "" if self.layout == "wide" else self.layout
        names = (self.what, self.technique, self.variant, layout, self.size, self.width, *settings)
        return "-".join(str(name) for name in names if name)


def distinct(cases: Sequence[Case]) -> list[Case]:
    """Each once, in order."""
    return list({str(case): case for case in cases}.values())


# Besides the defaults: what compiles other code into the same kernels.
OTHER_SETTINGS: dict[str, list[dict[str, Any]]] = {
    "srp": [
        {"storage": "fp32", "receiver_order": 1},
        {"storage": "snorm16", "probe_update": "half"},
    ],
    "gibs": [
        {"grid": "perspective", "ray_guiding": True},
        {"depth_moments": False, "grid_cells": 10, "placement": "rays"},
    ],
    "surfel-cache": [
        {"projection": "runtime", "sh_bands": 2},
        {"projection": "runtime", "sh_bands": 4, "exponent": 20.0},
    ],
    # With groups of 7: fewer texels, more than a group's all the same.
    "ddgi": [{"average": "encoded", "distance_texels": 5}],
    "irradiance-probes": [
        {"storage": "fp32", "bounces": "1"},
        {"update": "static", "gloss_steps": 2},
    ],
    "light-field-probes": [
        {"storage": "fp32", "bounces": "1", "gloss_steps": 3},
        {"update": "static"},
    ],
}

# Techniques with kernels of their own in the layout ``simt``; the others' are those of ``tuned``
# compiled for scalars, which is among their sizes.
WITH_A_LAYOUT = ("srp", "ddgi", "gibs", "surfel-cache")
OF_SIMT: dict[str, dict[str, Any]] = {"srp": {"sh_order": 4}}  # its tiles of rows are cut

# Rays of a receiver: two blocks of 16, the last not full; the simulator is slow.
BAKES = [
    Case("bake", 1, 16, "srp", settings={"transport_rays": 17}),
    Case(
        *("bake", 1, 1, "srp"),
        settings={"transport_rays": 17, "interpolation": "visibility", "receiver_order": 1},
    ),
]
SLOW_BAKES = [
    Case("bake", 1, 1, "srp"),
    Case("bake", 1, 16, "srp", settings={"interpolation": "visibility"}),
]


# Whose variants are the same kernels but for a few, compiled for vectors or not, as are those of
# both techniques of captured probes: variants take sizes and settings in turns.
IN_TURNS = ("irradiance-probes", "light-field-probes", "surfel-cache")


def frames(every: bool) -> list[Case]:
    """Of each variant: sizes and settings side by side, or what that leaves out of their product.

    The first size goes with the defaults, the next with the next settings.
    """
    found = []
    for number, spec in enumerate(techniques().values()):
        choices = [{}, *OTHER_SETTINGS.get(spec.name, [])]
        together = [
            (SIZES[n % len(SIZES)], choices[n % len(choices)])
            for n in range(max(len(SIZES), len(choices)))
        ]
        pairs = [(sizes, settings) for sizes in SIZES for settings in choices]
        for turn, variant in enumerate(spec.variants, number):
            few = together[turn % 2 :: 2] if spec.name in IN_TURNS else together
            found += [
                Case("frames", *sizes, spec.name, variant, settings)
                for sizes, settings in (pairs if every else few)
                if not (every and (sizes, settings) in few)
            ]
            if variant == TUNED and spec.name in WITH_A_LAYOUT:
                of_simt = choices[:-1] if every else choices[-1:]
                more = OF_SIMT.get(spec.name, {})
                found += [Case("frames", 7, 1, spec.name, variant, s | more, SIMT) for s in of_simt]
    return found


FRAMES, SLOW_FRAMES = frames(every=False), frames(every=True)
# Objects that move; surfels are placed on them.
MOVING = [
    *(Case("moving", size, width, "direct", "tuned") for size, width in SIZES),
    Case("moving", 16, 16, "gibs", "tuned"),
    # Materials that change: receivers, surfels, captured texels.
    Case("moving", 7, 4, "srp", "published"),
    Case("moving", 64, 1, "srp", "tuned", {"probe_update": "nearest"}),
    Case("changing", 7, 4, "srp", "tuned"),
    Case("changing", 16, 16, "surfel-cache", "tuned"),
    Case("changing", 64, 1, "irradiance-probes", "tuned"),
]
OTHERS = [Case(what, *sizes) for what in ("roofs", "rays") for sizes in SIZES]
OTHERS.append(Case("reference", *SIZES[1]))
# The same kernels with holes, images that emit and normal maps: by one size each, in turn.
_OF_MACROS = (
    "cut_rays",
    "cut_frames",
    "cut_reference",
    "glow_frames",
    "bumpy_frames",
    "glow_reference",
    "bumpy_reference",
)
OTHERS += [Case(what, *SIZES[n % len(SIZES)]) for n, what in enumerate(_OF_MACROS)]
SLOW_OTHERS = [Case(what, *sizes) for what in ("reference", *_OF_MACROS) for sizes in SIZES]
SLOW_OTHERS = [case for case in SLOW_OTHERS if case not in OTHERS]
