"""A tiny technique of two streaming passes, to run the whole frame loop in milliseconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from gibench.bake.stage import Keep, Stage, Unit, stage_key
from gibench.device import BufferSpec, Device, Launch, ProgramSpec, reads, scalar, writes
from gibench.errors import BadInput
from gibench.techniques.job import Job, Known, World
from gibench.techniques.registry import BakeContext, TechniqueSpec, Wakes
from gibench.techniques.technique import Pass, Work
from gibench.work import Worker

FLOATS = 4096


@dataclass(frozen=True)
class FakeSettings:
    sh_order: int = field(default=1, metadata={"axis": True, "title": "SH order"})
    probes: int | None = None
    bytes_per_receiver: int = 16
    floor_per_receiver: int = 0
    scale: float = 0.5
    flag: bool = False
    counted: bool = False
    fault: str | None = None
    fault_frame: int = 2
    rests_after: int | None = None
    wakes_after: int | None = None

    def __post_init__(self) -> None:
        if self.scale < 0:
            raise BadInput(f"scale is {self.scale}")


class Fake:
    name: ClassVar[str] = "fake"
    last_frame = -1

    def __init__(self, device: Device, job: Job, world: World) -> None:
        self.device, self.settings = device, FakeSettings()
        if isinstance(job.settings, FakeSettings):
            self.settings = job.settings
        self.receivers = len(world.lightmap.receivers)
        rng = np.random.default_rng(job.seed)
        self.held = device.allocate(
            held(self.receivers, self.settings.bytes_per_receiver),
            {"b": rng.random(FLOATS, np.float32)},
        )
        self.a, self.b = self.held["a"], self.held["b"]
        if self.settings.fault == "create":
            raise ValueError("told to fall over in /home/someone/secret/file.py")

    def passes(self) -> list[Pass]:
        def triad() -> list[Launch]:
            program = ProgramSpec("measure/roofs.cl", {"VEC": 4})
            arguments = (
                writes("a", self.a),
                reads("b", self.b),
                reads("c", self.b),
                scalar("scalar", np.float32(self.settings.scale)),
                scalar("count", np.uint32(FLOATS // 4)),
                scalar("stretch", np.uint32(1)),
            )
            return [Launch(program, "roof_triad", arguments, items=FLOATS // 4)]

        def read() -> list[Launch]:
            path = "no/such.cl" if self.settings.fault == "build" else "measure/roofs.cl"
            program = ProgramSpec(path, {"VEC": 4})
            arguments = (
                writes("sums", self.a),
                reads("b", self.b),
                scalar("count", np.uint32(FLOATS // 4)),
                scalar("stretch", np.uint32(4)),
            )
            return [Launch(program, "roof_read", arguments, items=FLOATS // 16, workgroup_size=32)]

        stream = Work(flops=2 * FLOATS, bytes_read=8 * FLOATS, bytes_written=4 * FLOATS)
        least = Work(bytes_read=4 * FLOATS)
        found = self._counted if self.settings.counted else None
        return [Pass("triad", triad, stream), Pass("read", read, least, found)]

    def _counted(self, workgroup_size: int) -> Work:
        """Told only after a frame: its number, and the size it is asked with."""
        return Work(bytes_read=4 * FLOATS, rays=1000 * self.last_frame + workgroup_size)

    def begin_frame(self, frame: int) -> None:
        self.last_frame = frame
        if frame == self.settings.fault_frame:
            if self.settings.fault == "interrupt":
                raise KeyboardInterrupt
            if self.settings.fault == "frame":
                raise RuntimeError("told to fall over in a frame")

    def images(self) -> dict[str, Any]:
        return {"frame": np.full((3, 4, 3), 0.25, np.float32)}

    def indirect_irradiance(self) -> Any:
        bad = np.nan if self.settings.fault == "nan" else 0.0
        return np.full((self.receivers, 3), bad, np.float32)

    def counts(self) -> dict[str, int]:
        return {"receivers": self.receivers, "probes": self.settings.probes or 7}


class Resting(Fake):
    """Tells that it is at rest from one frame on, and up to another."""

    def at_rest(self) -> bool:
        frames, settings = self.last_frame + 1, self.settings
        assert settings.rests_after is not None
        asleep = settings.wakes_after is None or frames < settings.wakes_after
        return frames >= settings.rests_after and asleep


def create(device: Device, job: Job, world: World) -> Fake:
    """One that tells where it is told when it rests."""
    tells = getattr(job.settings, "rests_after", None) is not None
    return (Resting if tells else Fake)(device, job, world)


def stages(context: BakeContext) -> tuple[Stage, ...]:
    """One that refuses if told so."""
    return (
        Stage("fake-bake", stage_key("fake-bake", 1), refuse, context.settings, keep=Keep.NEVER),
    )


def refuse(settings: Any, needed: Sequence[Any], unit: Unit, worker: Worker) -> None:
    if getattr(settings, "fault", None) == "bake":
        raise BadInput("the bake refuses")


def buffers(known: Known) -> list[BufferSpec]:
    """Before it is baked, a part of its state."""
    settings = known.job.settings
    if known.lightmap is None:
        return [BufferSpec.of("state", (known.receivers, settings.floor_per_receiver), np.uint8)]
    return held(known.receivers, settings.bytes_per_receiver)


def held(receivers: int, bytes_per_receiver: int) -> list[BufferSpec]:
    """What the technique allocates."""
    return [
        BufferSpec.of("a", FLOATS, np.float32),
        BufferSpec.of("b", FLOATS, np.float32),
        BufferSpec.of("state", (receivers, bytes_per_receiver), np.uint8),
    ]


def plain_buffers(known: Known) -> list[BufferSpec]:
    """Of what has no settings."""
    own = FakeSettings()
    return [] if known.lightmap is None else held(known.receivers, own.bytes_per_receiver)


SPEC = TechniqueSpec(
    name="fake",
    title="Two streaming passes",
    variants=("published", "tuned"),
    settings_type=FakeSettings,
    stages=stages,
    create=create,
    buffers=buffers,
    woken_by=frozenset({Wakes.CAMERA, Wakes.OBJECTS}),
    counts={"probes": "probes"},
)


@dataclass(frozen=True)
class PlainSettings:
    pass


PLAIN = TechniqueSpec(
    name="plain",
    title="One without options or variants",
    variants=("tuned",),
    settings_type=PlainSettings,
    stages=stages,
    create=Fake,
    buffers=plain_buffers,
)
