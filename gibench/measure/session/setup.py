"""Setting a configuration up: its scene, what is baked on it, a fresh device and the technique."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib.resources.abc import Traversable
from typing import Any

from gibench.device import Device
from gibench.errors import CannotRun
from gibench.measure.plan.configuration import Configuration
from gibench.measure.plan.fit import FEWEST_RECEIVERS, Footprint, has_receivers, measure_demand
from gibench.measure.plan.stopping import Plan
from gibench.measure.plan.view import choose_camera
from gibench.measure.runfolder.results import ConfigurationResult
from gibench.measure.session.shared import Shared
from gibench.scene.model import Scene
from gibench.techniques.camera_path import FlightOptions
from gibench.techniques.job import Job, Shot, World
from gibench.techniques.object_motion import MotionOptions
from gibench.techniques.registry import Follows, TechniqueSpec, techniques
from gibench.techniques.technique import HasNotes, Technique


@dataclass(frozen=True)
class LoopOptions:
    """How configurations are run.

    Attributes:
        plan: how many frames.
        width: of the camera image, pixels.
        height: of the camera image, pixels.
        camera: number or name; None for the scene's first.
        fit: lower the receivers until a configuration fits its profile.
        seed: of every random choice.
        flight: that drives the camera of every technique.
        motion: whether the scene's objects move, for every technique.
        kernel_root: another kernel tree than the installed one.
    """

    plan: Plan = field(default_factory=Plan)
    width: int = 1334
    height: int = 750
    camera: str | None = None
    fit: bool = False
    seed: int = 0
    flight: FlightOptions = field(default_factory=FlightOptions)
    motion: MotionOptions = field(default_factory=MotionOptions)
    kernel_root: Traversable | None = None


def check_configuration(
    configuration: Configuration, options: LoopOptions, shared: Shared
) -> Scene:
    """Check a configuration before any long work, and return its scene.

    Raises:
        BadInput: its scene, camera, camera path or motion is wrong, or the settings do not suit the
            scene.
    """
    scene = shared.scene(configuration.scene)
    choose_camera(scene, options.camera)
    options.flight.check()
    options.motion.of(scene)
    configuration.spec.check(scene, configuration.settings)
    return scene


def set_up(
    result: ConfigurationResult, options: LoopOptions, shared: Shared, cl_device: Any
) -> tuple[Device, Technique]:
    """A fresh device held to the profile, and the technique on it.

    What a reader must know about the configuration is noted in ``result``.

    Raises:
        CannotRun: it does not fit the profile (with ``fit``: at no number of receivers), or cannot
            follow objects that move.
    """
    configuration = result.configuration
    spec, settings, profile = configuration.spec, configuration.settings, configuration.profile
    scene = shared.scene(configuration.scene)
    camera = choose_camera(scene, options.camera)
    flight = options.flight.of(scene, camera)
    motion = options.motion.of(scene)
    if motion is not None and Follows.DIRECT_LIGHT not in spec.follows:
        raise _stands_still(spec)
    result.camera = camera.name
    asked = receivers = configuration.receivers or scene.receivers
    result.receivers_asked = asked
    footprint = Footprint(spec, scene, settings, options.width, options.height, profile)
    if options.fit:
        receivers = footprint.most_receivers(asked) or asked
    footprint.check(receivers)
    job = Job(
        spec.name,
        settings,
        configuration.variant,
        configuration.scene,
        profile,
        configuration.workgroup_size,
        configuration.receivers,
        options.seed,
        Shot(options.width, options.height, options.camera, options.flight, options.motion),
    )
    while True:
        lightmap, baked = shared.baked(spec, settings, configuration.scene, receivers)
        device = Device(profile, cl_device, options.kernel_root)
        world = World(scene, lightmap, baked, camera, flight, motion)
        try:
            technique = spec.create(device, job, world)
            break
        except CannotRun as error:
            demand = measure_demand(spec, device, job, world)
            fewer = 0
            if demand is not None and has_receivers(spec):
                fewer = demand.receivers_that_fit(profile, receivers)
            if not options.fit or fewer < FEWEST_RECEIVERS:
                raise demand.refusal(spec, scene, profile, receivers) if demand else error from None
            receivers = fewer
    if receivers != asked:
        result.reason = f"fitted: aims for {receivers:,} receivers instead of {asked:,}"
        result.notes.append(f"{result.reason}, so that it fits profile {profile.name}")
    if motion is not None:
        result.notes.append(motion.note())
        if Follows.INDIRECT_LIGHT not in spec.follows:
            result.notes.append("its indirect light stays that of the scene at rest")
    if isinstance(technique, HasNotes):
        result.notes += technique.notes()
    return device, technique


def _stands_still(spec: TechniqueSpec) -> CannotRun:
    able = sorted(one.name for one in techniques().values() if Follows.DIRECT_LIGHT in one.follows)
    return CannotRun(
        f"{spec.name} cannot follow objects that move: what it bakes holds for the scene at rest",
        mend=f"run it without --motion, or {', '.join(able)} with it",
    )
