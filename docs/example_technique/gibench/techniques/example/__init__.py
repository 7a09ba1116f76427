"""A worked example: how open the space around probes is, as the light that reaches surfaces."""

from __future__ import annotations

from gibench.techniques.example.settings import ExampleSettings
from gibench.techniques.example.stages import stages
from gibench.techniques.example.technique import Example, buffers

from gibench.scene.model import Scene
from gibench.techniques.registry import TUNED, Follows, TechniqueSpec

__all__ = ["SPEC", "Example", "ExampleSettings"]


def _sweep(scene: Scene) -> dict[str, tuple[float, ...]]:
    return {"reach": (0.5, 2.0)}


SPEC = TechniqueSpec(
    name="example",
    title="Openness (a worked example)",
    variants=(TUNED,),
    settings_type=ExampleSettings,
    create=Example,
    buffers=buffers,
    stages=stages,
    sweep=_sweep,
    follows=frozenset({Follows.DIRECT_LIGHT}),
    memory_options=("--set example.counts", "--resolution"),
)
