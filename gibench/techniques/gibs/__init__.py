"""GIBS: global illumination based on surfels (Brinck et al. 2021; Ekberg 2022, chapters 3-4)."""

from __future__ import annotations

from gibench.scene.model import Scene
from gibench.techniques.gibs.remarks import flaws, remarks
from gibench.techniques.gibs.settings import GibsSettings
from gibench.techniques.gibs.technique import Gibs, buffers
from gibench.techniques.registry import (
    PUBLISHED,
    TUNED,
    Follows,
    Knob,
    TechniqueSpec,
    Wakes,
    steps,
)

__all__ = ["SPEC", "Gibs", "GibsSettings"]


def _sweep(scene: Scene) -> dict[str, tuple[float, ...]]:
    return {"rays_per_surfel": (1.0, 4.0)}


def _knobs(scene: Scene) -> tuple[Knob, ...]:
    return Knob("rays_per_surfel", steps(0.25, 16.0, 27)), Knob("radius_share", (0.05, 0.03, 0.02))


SPEC = TechniqueSpec(
    name="gibs",
    title="Surfels (GIBS)",
    variants=(PUBLISHED, TUNED),
    settings_type=GibsSettings,
    create=Gibs,
    buffers=buffers,
    follows=frozenset({Follows.DIRECT_LIGHT, Follows.INDIRECT_LIGHT}),
    # Where surfels are placed has nothing to do with lights.
    woken_by=frozenset({Wakes.CAMERA, Wakes.OBJECTS}),
    memory_options=("--set gibs.surfels", "--resolution"),
    sweep=_sweep,
    knobs=_knobs,
    remarks=remarks,
    flaws=flaws,
    counts={"surfels": "surfel_capacity"},
)
