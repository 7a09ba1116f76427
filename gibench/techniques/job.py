"""What one technique is asked to do (a job), and the world it does it in.

A job is plain data: it pickles, and goes to JSON and back
(:func:`gibench.techniques.registry.job_of`), so that another process can run it. The files of its
scene, flight and motion it names by their path as given, which holds in the same working folder
alone; :meth:`Job.anywhere` is for a process in another. A world is what its names stand for once
they are loaded and baked.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal

from gibench.device import WIDE, Device, Layout
from gibench.profiles import DeviceProfile
from gibench.rays.bvh import Bvh
from gibench.scene.lightmap import Lightmap
from gibench.scene.load import is_file
from gibench.scene.model import Camera, Scene
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.camera_path import BUILT_IN, Flight, FlightOptions
from gibench.techniques.clock import Clock
from gibench.techniques.object_motion import REST, SCENE, MotionOptions

AUTO: Final = "auto"
"""A work-group size that is measured: every pass takes its best."""


@dataclass(frozen=True)
class Shot:
    """What the camera takes, and what moves meanwhile.

    Attributes:
        width: of the camera image, pixels.
        height: of the camera image, pixels.
        camera: number or name; None for the scene's first.
        flight: that drives the camera.
        motion: whether the scene's objects move.
    """

    width: int = 1334
    height: int = 750
    camera: str | None = None
    flight: FlightOptions = field(default_factory=FlightOptions)
    motion: MotionOptions = field(default_factory=MotionOptions)


@dataclass(frozen=True)
class Job:
    """One technique with its settings on one scene, within one profile's limits.

    Attributes:
        technique: its name.
        settings: the technique's own settings dataclass.
        variant: ``published`` or ``tuned``.
        scene: a built-in name or a file.
        profile: whose limits bind.
        workgroup_size: work-items per group wherever the algorithm does not fix it, or ``auto``.
        receivers: number to aim for; None leaves it to the scene.
        seed: of every random choice.
        shot: image, camera, flight and motion.
        layout: of the variant ``tuned``; None where the device decides, and as ``published``.
    """

    technique: str
    settings: Any
    variant: str
    scene: str
    profile: DeviceProfile
    workgroup_size: int | Literal["auto"]
    receivers: int | None = None
    seed: int = 0
    shot: Shot = field(default_factory=Shot)
    layout: Layout | None = None

    @property
    def group_size(self) -> int:
        """Work-items per group; with ``auto`` the profile's own, until a better one is found."""
        if self.workgroup_size == AUTO:
            return self.profile.default_workgroup_size
        return self.workgroup_size

    def record(self) -> dict[str, Any]:
        """As JSON can hold it; files by their path as given."""
        return asdict(self)

    def anywhere(self) -> Job:
        """The same job for a process in any folder of this machine: its files' paths absolute."""
        flight, motion = self.shot.flight, self.shot.motion
        if flight.path not in BUILT_IN:
            flight = replace(flight, path=str(Path(flight.path).absolute()))
        if motion.path not in (REST, SCENE):
            motion = replace(motion, path=str(Path(motion.path).absolute()))
        scene = str(Path(self.scene).absolute()) if is_file(self.scene) else self.scene
        return replace(self, scene=scene, shot=replace(self.shot, flight=flight, motion=motion))


@dataclass(frozen=True)
class World:
    """What a job's names stand for, loaded and baked; no device is involved.

    Attributes:
        scene: the scene.
        lightmap: its atlas.
        baked: what the technique's ``bake`` returned.
        camera: the view.
        flight: that the camera takes; None where it rests.
        motion: of the scene's objects; None where they rest.
        clock: tells which of the scene's frames a frame shows.
    """

    scene: Scene
    lightmap: Lightmap
    baked: Any
    camera: Camera
    flight: Flight | None = None
    motion: MovingObjects | None = None
    clock: Clock = field(default_factory=Clock, compare=False)

    @property
    def moves(self) -> bool:
        """Whether any of it is elsewhere in other frames."""
        motion = self.motion
        changes = motion is not None and (motion.moves or motion.materials is not None)
        return self.scene.lights_move or self.flight is not None or changes


@dataclass(frozen=True)
class Known:
    """What is known of a job when a technique's buffers are declared: at first what is asked and
    the scene, later all that decides how large they are.

    Attributes:
        job: what is asked.
        scene: the scene.
        receivers: how many there are, or how many are aimed for.
        motion: of the scene's objects; None where they rest.
        lightmap: the scene's atlas; None as long as there is none, and nothing baked.
        baked: what the technique's ``bake`` returned.
        bvh: the scene's tree; None as long as it is not built.
        vector_width: floats per vector of the executing device; 1, the least, as long as none is
            opened.
        layout: of kernels that are tuned.
        lanes_together: work-items that the executing device computes in whole vectors only
            (``Device.lanes_together``).
    """

    job: Job
    scene: Scene
    receivers: int
    motion: MovingObjects | None = None
    lightmap: Lightmap | None = None
    baked: Any = None
    bvh: Bvh | None = None
    vector_width: int = 1
    layout: Layout = WIDE
    lanes_together: int = 1

    @staticmethod
    def all_of(job: Job, world: World, bvh: Bvh, device: Device) -> Known:
        """All of it on ``device``: what is declared from this is what is allocated."""
        return Known(
            job=job,
            scene=world.scene,
            receivers=len(world.lightmap.receivers),
            motion=world.motion,
            lightmap=world.lightmap,
            baked=world.baked,
            bvh=bvh,
            vector_width=device.vector_width,
            layout=device.layout,
            lanes_together=device.lanes_together,
        )
