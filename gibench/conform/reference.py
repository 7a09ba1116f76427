"""The path tracer's kernels, together, against closed forms."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gibench.arrays import Array
from gibench.device import Device
from gibench.errors import CannotRun
from gibench.rays.embree import EmbreeTracer
from gibench.reference.camera import image_plane
from gibench.reference.host_cl import program_on
from gibench.reference.packed import pack_fragments, pack_scene
from gibench.reference.starts import CameraStart, ReceiverStart
from gibench.reference.wavefront import Wavefront
from gibench.scene.environment import Environment
from gibench.scene.lightmap import Fragments
from gibench.scene.model import Camera, Material, Scene
from gibench.techniques.parts.conformance.case import Bench, Case, off

SAMPLES, BOUNCES = 1024, 2
# Means over 12 or 35 owners; two parts in a hundred are five of their standard errors and more.
TOLERANCE = 0.02


def _box() -> Array:
    """The twelve triangles (12, 3, 3) of a unit box, fronts on the inside."""
    x, y, z = np.eye(3)
    o = np.zeros(3)
    faces = ((o, x, y), (z, y, x), (o, z, x), (y, x, z), (o, y, z), (x, z, y))
    found = []
    for a, e, f in faces:
        found += [[a, a + e, a + e + f], [a, a + e + f, a + f]]
    return np.array(found, np.float32)


def _furnace(material: Material, sky: float = 0.0, triangles: int = 12) -> Scene:
    corners = _box()[:triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    count = len(corners)
    return Scene(
        "furnace",
        corners.reshape(-1, 3),
        np.repeat(normal, 3, axis=0).astype(np.float32),
        np.zeros((3 * count, 2), np.float32),
        np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        np.zeros(count, np.int32),
        np.zeros(count, np.int32),
        (material,),
        environment=Environment.constant((sky, sky, sky)),
    )


def _fragments(scene: Scene) -> Fragments:
    """A receiver on each triangle."""
    count = len(scene.triangles)
    return Fragments(
        start=np.arange(count + 1, dtype=np.int64),
        corners=scene.corners,
        triangle=np.arange(count, dtype=np.int32),
        area=np.full(count, 0.5, np.float32),
    )


def _check(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Glowing walls lit by each other, and a floor under an even sky."""
    if not bench.cl_device.host_unified_memory:
        raise CannotRun("the reference runs on devices that share the host's memory")
    device = Device.unlimited(bench.cl_device, bench.kernel_root)
    program = program_on(device, size)
    seed = int(rng.integers(1 << 30))
    glow = Material("glow", (0.5, 0.25, 0.8), (1.0, 2.0, 3.0))
    scene = _furnace(glow)
    tracer, packed = EmbreeTracer(scene.corners), pack_scene(scene, 0)
    start = ReceiverStart(pack_fragments(_fragments(scene)))
    mean = Wavefront(packed, tracer, start, BOUNCES, program=program).round(SAMPLES, seed)
    albedo, emission = np.array(glow.base_color), np.array(glow.emission)
    series = sum(albedo**k for k in range(BOUNCES + 1))
    yield off(mean.mean(axis=0), emission * series, relative=TOLERANCE)  # over pi
    plane = image_plane(Camera((0.5, 0.5, 0.9), (0.4, 0.45, 0.0)), 7, 5)
    seen = CameraStart(plane, 7, 5, indirect_only=False, plain=False)
    image = Wavefront(packed, tracer, seen, BOUNCES, program=program).round(SAMPLES, seed)
    mean = image.reshape(-1, 3).mean(axis=0)
    series = sum(albedo**k for k in range(BOUNCES + 2))
    yield off(mean, emission * series, relative=TOLERANCE)
    floor = _furnace(Material("dark", (0.0, 0.0, 0.0)), 1.5, triangles=2)
    start = ReceiverStart(pack_fragments(_fragments(floor)))
    under = Wavefront(pack_scene(floor, 0), EmbreeTracer(floor.corners), start, 0, program=program)
    sky = under.round(SAMPLES, seed).mean(axis=0)
    yield off(sky, np.full(3, 1.5), relative=TOLERANCE)


CASES = [
    Case(
        "Path tracing of a furnace",
        tuple(
            f"reference/{name}"
            for name in (
                "draws.cl:draw_starts",
                "draws.cl:scatter",
                "path.cl:start_at_receivers",
                "path.cl:start_at_camera",
                "path.cl:connect",
                "path.cl:resolve",
                "path.cl:shade",
                "path.cl:average",
            )
        ),
        _check,
        (7, 64),
    )
]
