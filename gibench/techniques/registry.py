"""Finding the techniques: every module or package beside this one that defines ``SPEC``."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from gibench.device import Device
from gibench.errors import BadInput
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Camera, Scene
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.camera_path import Flight
from gibench.techniques.technique import Technique

PUBLISHED = "published"
TUNED = "tuned"


@dataclass(frozen=True)
class BakeContext:
    """What a technique may bake from; no device is involved.

    Attributes:
        scene: the scene.
        lightmap: its atlas.
        settings: the technique's own settings dataclass.
        cache_dir: where baked data is kept.
        seed: of every random choice.
    """

    scene: Scene
    lightmap: Lightmap
    settings: Any
    cache_dir: Path
    seed: int = 0


@dataclass(frozen=True)
class CreateContext:
    """What a technique is created from.

    Attributes:
        device: where it will run.
        scene: the scene.
        lightmap: its atlas.
        settings: the technique's own settings dataclass.
        baked: what the technique's ``bake`` returned.
        variant: ``published`` or ``tuned``.
        workgroup_size: work-items per group wherever the algorithm does not fix it.
        width: of the camera image, pixels.
        height: of the camera image, pixels.
        camera: the view.
        seed: of every random choice.
        flight: that the camera takes; None where it rests.
        motion: of the scene's objects; None where they rest.
    """

    device: Device
    scene: Scene
    lightmap: Lightmap
    settings: Any
    baked: Any
    variant: str
    workgroup_size: int
    width: int
    height: int
    camera: Camera
    seed: int = 0
    flight: Flight | None = None
    motion: MovingObjects | None = None


@dataclass(frozen=True)
class TechniqueSpec:
    """A technique as the command line sees it.

    Attributes:
        name: on the command line.
        title: in words.
        variants: those it has; ``tuned`` is run by default.
        settings_type: a dataclass with defaults; field metadata carries ``help`` and ``unit``.
            Fields called ``sh_order`` and ``probes`` are set by the options of that name, all
            others by ``--set technique.field=value``.
        bake: computes or loads what is needed ahead of frames.
        create: sets the technique up on a device.
        memory_floor: bytes of device memory it will take at least, known before baking, from
            (scene, number of receivers, settings, image width, image height).
        sweep: for a scene, the values by setting that ``gibench advise`` tries, every
            combination of them.
        check: refuses settings that do not suit a scene (BadInput) before any long work.
        follows_motion: whether it renders objects that move; what holds only for the scene at rest
            (a bake) does not.
        memory_options: what on the command line lowers its memory, for messages; its receivers
            are on the device only where ``--receivers`` is among them.
    """

    name: str
    title: str
    variants: tuple[str, ...]
    settings_type: type[Any]
    bake: Callable[[BakeContext], Any]
    create: Callable[[CreateContext], Technique]
    memory_floor: Callable[[Scene, int, Any, int, int], int]
    sweep: Callable[[Scene], Mapping[str, tuple[Any, ...]]] = field(default=lambda scene: {})
    check: Callable[[Scene, Any], None] = field(default=lambda scene, settings: None)
    follows_motion: bool = False
    memory_options: tuple[str, ...] = ("--receivers", "--probes", "--sh-order", "--resolution")

    def settings(self, values: Mapping[str, Any]) -> Any:
        """The settings with ``values`` set.

        Raises:
            BadInput: there is no such setting, or the settings refuse the value.
        """
        known = {item.name for item in fields(self.settings_type)}
        if unknown := sorted(set(values) - known):
            raise BadInput(
                f"technique {self.name} has no setting '{unknown[0]}'",
                mend=f"it has {', '.join(sorted(known))}",
            )
        return replace(self.settings_type(), **values)


def techniques() -> dict[str, TechniqueSpec]:
    """Every technique's spec by name."""
    import gibench.techniques as package

    specs = {}
    for module in pkgutil.iter_modules(package.__path__):
        spec = getattr(import_module(f"{package.__name__}.{module.name}"), "SPEC", None)
        if isinstance(spec, TechniqueSpec):
            specs[spec.name] = spec
    return specs


def find_technique(name: str) -> TechniqueSpec:
    """The technique called ``name``.

    Raises:
        BadInput: there is none.
    """
    specs = techniques()
    if name not in specs:
        raise BadInput(
            f"no technique called '{name}'", mend=f"the techniques are {', '.join(sorted(specs))}"
        )
    return specs[name]
