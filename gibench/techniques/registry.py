"""Finding the techniques: every module or package beside this one that defines ``SPEC``."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.bake.run import BakeReport, bake_seconds, run_bake
from gibench.bake.stage import Stage
from gibench.device import BufferSpec, Device
from gibench.errors import BadInput
from gibench.profiles.machine import Interval, Machine
from gibench.profiles.profile import DeviceProfile, Figure
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Camera, Scene
from gibench.techniques.camera_path import FlightOptions
from gibench.techniques.job import Job, Known, Shot, World
from gibench.techniques.object_motion import MotionOptions
from gibench.techniques.technique import Technique
from gibench.work import Executor

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
        moving: (t,) which of the scene's triangles will move; None where all rest. A technique may
            leave them out of what it bakes.
    """

    scene: Scene
    lightmap: Lightmap
    settings: Any
    cache_dir: Path
    seed: int = 0
    moving: npt.NDArray[np.bool_] | None = None


class Follows(Enum):
    """What of a technique follows things that move."""

    DIRECT_LIGHT = "direct light"
    """What the camera sees, and the light that comes straight to it from point, spot and
    directional lights."""
    INDIRECT_LIGHT = "indirect light"
    """The light that surfaces throw on each other; otherwise it stays that of the scene at rest."""
    RECEIVERS = "receivers"
    """The lightmap's receivers are asked for where they have moved to."""


class Wakes(Enum):
    """What moves and may keep a technique from ever being at rest, in words."""

    CAMERA = "the camera flies"
    OBJECTS = "objects move"
    LIGHTS = "lights move"
    """Or what surfaces send out changes: their albedo or emission."""


def no_sweep(scene: Scene) -> Mapping[str, tuple[Any, ...]]:
    """For a technique of which advice tries nothing but its defaults."""
    return {}


@dataclass(frozen=True)
class Knob:
    """A setting that trades cost for quality.

    Attributes:
        setting: its name.
        rungs: its values, from cheap to dear.
    """

    setting: str
    rungs: tuple[Any, ...]


def steps(low: float, high: float, count: int, *, whole: bool = False) -> tuple[Any, ...]:
    """``count`` values from ``low`` to ``high``, each the same number of times the last; rounded to
    whole ones, those that fall together once.
    """
    ratio = (high / low) ** (1 / (count - 1))
    found = [low * ratio**n for n in range(count)]
    return tuple(dict.fromkeys(round(value) if whole else float(f"{value:.4g}") for value in found))


def no_knobs(scene: Scene) -> tuple[Knob, ...]:
    """For a technique whose cost cannot be turned."""
    return ()


def no_check(scene: Scene, settings: Any) -> None:
    """For a technique whose settings suit every scene."""


def no_moving_check(settings: Any) -> None:
    """For a technique that follows objects that move however it is set, or not at all."""


def no_remarks(job: Job, scene: Scene, camera: Camera) -> list[str]:
    """For a technique that suits every scene."""
    return []


def no_bake_remarks(job: Job, context: BakeContext) -> list[str]:
    """For a technique whose bake never keeps light from a scene."""
    return []


def no_flaws(job: Job, scene: Scene, camera: Camera) -> list[str]:
    """For a technique whose light is right everywhere where its mean is."""
    return []


def no_normal_maps(settings: Any) -> bool:
    """For a technique that shades with no normal maps."""
    return False


def nothing_baked(context: BakeContext) -> tuple[Stage, ...]:
    """The stages of a technique that computes nothing ahead of frames."""
    return ()


@dataclass(frozen=True)
class TechniqueSpec:
    """A technique as the command line sees it; plain functions only, so that it pickles.

    Attributes:
        name: on the command line.
        title: in words.
        variants: those it has; ``tuned`` is run by default.
        settings_type: a dataclass with defaults; field metadata carries ``help`` and ``unit``,
            ``title`` where its name alone does not read well, and ``axis`` where every table has a
            column of it.
        create: sets the technique up on a device.
        buffers: what it holds on the device while frames run, whose sum is its memory. Once all is
            known, every buffer as it is allocated. Before anything is baked or opened, a lower
            bound: no buffer that will not be there, and none larger than it will be.
        stages: of what is computed ahead of frames, each after those it needs; the last one's value
            is what the technique is created with, None where there are none.
        sweep: for a scene, the values by setting that ``gibench advise`` tries, every
            combination of them.
        knobs: for a scene, what trades its cost for quality: the first is searched for a cost or an
            error, at each combination of the others' few values.
        check: refuses settings that do not suit a scene (BadInput) before any long work.
        check_moving: likewise settings that do not suit objects that move.
        remarks: why the technique will not come within 10 % of the scene's mean indirect light,
            told before a run: by tests of geometry, lights and settings, a sentence without a full
            stop each, with the setting that would help and what it costs.
        bake_remarks: likewise, by what a short first part of the bake finds, told before the rest
            of it.
        flaws: why light will be where it should not, or noise, though its mean over the scene may
            be right, told likewise.
        shades_normal_maps: whether it shades what the camera sees with the scene's normal maps, as
            it is set.
        normal_map_options: what on the command line makes it; empty where nothing does.
        follows: what of it follows objects that move; what holds only for the scene at rest (a
            bake) does not. One that does not follow with its direct light is not run with motion.
        bakes_what_rests: whether it leaves what moves out of its bake, so that with motion it is
            baked anew.
        woken_by: what, where it moves, keeps it from ever being at rest
            (:class:`gibench.techniques.technique.KnowsItsRest`).
        counts: those of :meth:`Technique.counts` that tables show; by name, the one that stands for
            it where a configuration is told from others, in which chance has no part.
        long_bake: whether its bake takes minutes: where nobody named it, it is run only if that is
            stored already.
        expected: what it will hold about, told from the same as ``buffers`` before anything is
            baked, where that bound is far below it: settings that would fit are found by this.
        memory_options: what on the command line lowers its memory, for messages; its receivers
            are on the device only where ``--receivers`` is among them.
    """

    name: str
    title: str
    variants: tuple[str, ...]
    settings_type: type[Any]
    create: Callable[[Device, Job, World], Technique]
    buffers: Callable[[Known], list[BufferSpec]]
    stages: Callable[[BakeContext], Sequence[Stage]] = nothing_baked
    sweep: Callable[[Scene], Mapping[str, tuple[Any, ...]]] = no_sweep
    knobs: Callable[[Scene], Sequence[Knob]] = no_knobs
    check: Callable[[Scene, Any], None] = no_check
    check_moving: Callable[[Any], None] = no_moving_check
    remarks: Callable[[Job, Scene, Camera], list[str]] = no_remarks
    bake_remarks: Callable[[Job, BakeContext], list[str]] = no_bake_remarks
    flaws: Callable[[Job, Scene, Camera], list[str]] = no_flaws
    shades_normal_maps: Callable[[Any], bool] = no_normal_maps
    normal_map_options: str = ""
    follows: frozenset[Follows] = frozenset()
    bakes_what_rests: bool = False
    woken_by: frozenset[Wakes] = frozenset(Wakes)
    counts: Mapping[str, str] = field(default_factory=dict)
    long_bake: bool = False
    expected: Callable[[Known], list[BufferSpec]] | None = None
    memory_options: tuple[str, ...] = ("--receivers", "--probes", "--sh-order", "--resolution")

    def expects(self, known: Known) -> list[BufferSpec]:
        """What it will hold about, as far as ``known`` tells."""
        return (self.expected or self.buffers)(known)

    def bake_key(self, context: BakeContext) -> str:
        """Tells what :meth:`bake` returns from all else; empty where nothing is baked."""
        stages = self.stages(context)
        return stages[-1].key if stages else ""

    def bake(
        self,
        context: BakeContext,
        executor: Executor | None = None,
        report: BakeReport | None = None,
    ) -> Any:
        """Compute what is needed ahead of frames, or load what of it is in the cache already.

        Raises:
            GibenchError: see :func:`gibench.bake.run.run_bake`.
        """
        return run_bake(self.stages(context), context.cache_dir, executor, report)

    def bake_seconds(self, context: BakeContext) -> float:
        """Wall time, s, that :meth:`bake` has taken, now or when it was stored."""
        return bake_seconds(self.stages(context), context.cache_dir)

    def settings(self, values: Mapping[str, Any]) -> Any:
        """The settings with ``values`` set.

        Raises:
            BadInput: there is no such setting, or the settings refuse the value.
        """
        known = {item.name for item in fields(self.settings_type)}
        if unknown := sorted(set(values) - known):
            raise BadInput(
                f"technique {self.name} has no setting '{unknown[0]}'",
                mend=f"it has {', '.join(sorted(known)) or 'none'}",
            )
        return self.settings_type(**values)


def techniques() -> dict[str, TechniqueSpec]:
    """Every technique's spec by name."""
    import gibench.techniques as package

    specs = {}
    for module in pkgutil.iter_modules(package.__path__):
        spec = getattr(import_module(f"{package.__name__}.{module.name}"), "SPEC", None)
        if isinstance(spec, TechniqueSpec):
            specs[spec.name] = spec
    return specs


def declared_axes() -> tuple[str, ...]:
    """Settings that have a column in every table, whether they differ in a run or not: those whose
    field says ``axis``.
    """
    return tuple(
        dict.fromkeys(
            item.name
            for spec in techniques().values()
            for item in fields(spec.settings_type)
            if item.metadata.get("axis")
        )
    )


def axis_title(name: str) -> str:
    """What a setting is called where a table or a label is read."""
    for spec in techniques().values():
        for item in fields(spec.settings_type):
            if item.name == name and "title" in item.metadata:
                return str(item.metadata["title"])
    return name.replace("_", " ")


def declared_counts() -> dict[str, str]:
    """All techniques' ``counts``, those in which chance has a part first."""
    found = {name: of for spec in techniques().values() for name, of in spec.counts.items()}
    return dict(sorted(found.items(), key=lambda item: item[0] == item[1]))


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


def job_of(record: Mapping[str, Any]) -> Job:
    """The job whose :meth:`Job.record` this is.

    Raises:
        BadInput: there is no such technique or setting.
    """
    shot, profile = dict(record["shot"]), dict(record["profile"])
    shot["flight"] = FlightOptions(**shot["flight"])
    shot["motion"] = MotionOptions(**shot["motion"])
    profile["figures"] = {name: Figure(**each) for name, each in profile["figures"].items()}
    if (machine := profile["machine"]) is not None:
        profile["machine"] = Machine(**{name: Interval(**each) for name, each in machine.items()})
    named = {
        "settings": find_technique(record["technique"]).settings(record["settings"]),
        "profile": DeviceProfile(**profile),
        "shot": Shot(**shot),
    }
    return Job(**{**record, **named})


def left_out(spec: TechniqueSpec, settings: Any, scene: Scene) -> list[str]:
    """What of ``scene`` the technique does not show as it is set, and what would."""
    if scene.normal_maps is None or spec.shades_normal_maps(settings):
        return []
    if spec.normal_map_options:
        return [f"normal maps are not used; {spec.normal_map_options} uses them"]
    able = [own for own in techniques().values() if own.normal_map_options]
    others = " or ".join(f"{own.name} with {own.normal_map_options}" for own in able)
    return [f"normal maps are not used{f', but by {others}' if others else ''}"]
