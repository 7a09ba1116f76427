"""The example on a device: a frame looks the probes up at every pixel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from gibench.techniques.example.settings import ExampleSettings
from gibench.techniques.example.stages import volume_of

from gibench.arrays import Floats
from gibench.device import Argument, BufferSpec, Device, Launch, integer, reads, scalar, writes
from gibench.techniques.job import Job, Known, World
from gibench.techniques.parts.camera_pass import Application, lookup_defines
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.technique import FloatArray, Pass

SOURCE = "example/application.cl"
# A place between a triangle's corners; in the grid; then eight probes: three shares of three
# operations each, two products, a product and a sum.
_LOOKUP_FLOPS = 2 + 3 * 5 + 3 * 3 + 8 * (3 * 3 + 2 + 2)


def own_buffers(settings: ExampleSettings) -> tuple[BufferSpec, BufferSpec]:
    """The buffers beyond the scene's and the camera's: the volume, and each probe's openness."""
    probes = int(np.prod(settings.grid))
    return BufferSpec.of("volume", 9, np.float32), BufferSpec.of("openness", probes, np.float32)


def buffers(known: Known) -> list[BufferSpec]:
    """All its buffers."""
    shot, settings = known.job.shot, known.job.settings
    hits = HitBuffer.spec(shot.width, shot.height)
    return [*FrameScene.declared(known), *own_buffers(settings), hits]


class Example:
    """Light from wherever it is open, as probes see it.

    Args:
        device: where it runs.
        job: what is asked.
        world: what is seen; ``baked`` is the openness of every probe.

    Raises:
        CannotRun: it does not fit the device's profile.
    """

    name: ClassVar[str] = "example"

    def __init__(self, device: Device, job: Job, world: World) -> None:
        settings: ExampleSettings = job.settings
        openness: Floats = world.baked
        self.device, self.settings = device, settings
        self._job, self._world = job, world
        self.scene = FrameScene.of(device, job.shot, world)
        volume = volume_of(world.scene, settings)
        table, shares = own_buffers(settings)
        self._lookup: tuple[Argument, ...] = (
            reads("volume", device.create(table, volume.table())),
            reads("openness", device.create(shares, openness)),
            scalar("ambient", np.float32(settings.ambient)),
        )
        defines = {**volume.defines, **lookup_defines(device)}
        self._program = self.scene.program(SOURCE, defines)
        self._application = Application(
            scene=self.scene,
            hits=HitBuffer.create(device, job.shot.width, job.shot.height),
            program=self._program,
            args=(*self.scene.surfaces.shape_args, *self._lookup),
            flops=_LOOKUP_FLOPS,
        )

    def passes(self) -> Sequence[Pass]:
        """The camera's pass, and the lookup."""
        return self._application.passes()

    def begin_frame(self, frame: int) -> None:
        """Move lights and camera."""
        self.scene.begin_frame(frame)

    def images(self) -> dict[str, FloatArray]:
        """The frame, its direct and its indirect part, (h, w, 3) W/m2/sr."""
        return self._application.images(self._job.group_size)

    def indirect_irradiance(self) -> FloatArray:
        """Indirect irradiance (n, 3) at the receivers, W/m2."""
        receivers, device = self._world.lightmap.receivers, self.device
        position = device.upload("receiver_position", receivers.position)
        found = device.empty("receiver_irradiance", (len(receivers), 3), np.float32)
        args = (
            *self._lookup,
            reads("position", position),
            integer("count", len(receivers)),
            writes("irradiance", found),
        )
        launch = Launch(self._program, "receiver_openness", args, items=len(receivers))
        try:
            device.enqueue(launch, self._job.group_size)
            return device.read(found)
        finally:
            device.release(position, found)

    def counts(self) -> dict[str, int]:
        """Probes, and the receivers it is compared on."""
        probes = int(np.prod(self.settings.grid))
        return {"probes": probes, "receivers": len(self._world.lightmap.receivers)}
