"""Run cases of cases.py on tiny problems; meant to be started under Oclgrind, one case at a time.

Prints the full name of every kernel that ran, one to a line.

Usage: python run_case.py CACHE_DIR CASE... (a case is a JSON object of Case's fields)
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyopencl as cl

sys.path.insert(0, str(Path(__file__).parents[1]))

from cases import Case
from recording import recorded_kernels
from support.cut_scenes import cut_at_random
from support.glow_scenes import bumpy, glowing
from support.made import made as create
from support.reference_scenes import lightmap_of, random_scene

from gibench.device import Argument, Device, SharedBuffer, count_rays, list_devices
from gibench.measure.machine import calibration as calibration_module
from gibench.measure.machine import roofs as roofs_module
from gibench.measure.session.enqueue import PreparedPass, enqueue_frame, prepare_passes
from gibench.profiles import load_profile
from gibench.rays.bvh import build_bvh
from gibench.rays.device_bvh import DeviceBvh, DeviceTracer
from gibench.rays.embree import EmbreeTracer
from gibench.reference import host_cl, wavefront
from gibench.reference.camera import image_plane
from gibench.reference.host_cl import HostProgram
from gibench.reference.packed import pack_fragments, pack_scene
from gibench.reference.starts import CameraStart, ReceiverStart
from gibench.reference.wavefront import Wavefront
from gibench.scene.builtin import build
from gibench.scene.colours import Colours
from gibench.scene.lightmap.atlas import unwrap
from gibench.scene.model import Camera, ProbeSettings, Scene
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.scene.poses import Turn
from gibench.techniques.ddgi import simt_blending
from gibench.techniques.parts.camera_pass import camera_launch, rendered
from gibench.techniques.parts.frame_lightmap import FrameLightmap
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.gloss_table import GlossTable
from gibench.techniques.parts.normal_map_table import NormalMapTable
from gibench.techniques.parts.receiver_signal import ReceiverSignal
from gibench.techniques.registry import BakeContext, TechniqueSpec, find_technique
from gibench.techniques.srp.application import srp_application
from gibench.techniques.technique import Technique
from gibench.work import Serial

# Enough for every kernel's loops, borders and remainders; the simulator is slow.
RECEIVERS = 71
# Frames, and the pixels of a side of a tile. Surfels placed in the first frame are known in the
# second and live in the third; of the others, the second frame meets what the first left.
FRAMES_AND_TILES = {"gibs": (3, 16)}
# SRP's, given: choosing them is no kernel's work.
PROBES = ((0.5, 1.6, 0.4), (-0.5, 1.4, -0.3), (0.1, 1.3, 0.6))
OF_OTHERS = (2, 8)
# Of an image, tiles a row and a column, by work-group size: the last of each is not full. Two by
# two once; beside each other or above each other they cost the simulator half.
TILES = {16: (2, 2), 7: (2, 1), 64: (1, 2)}
SMALL = {
    "sh_order": 2,
    "probes": 3,
    "relight_samples": 40,
    "transport_rays": 24,
    "rays": 40,
    "distance_texels": 9,  # more texels than the largest group has work-items
    "surfels": 300,
    "ray_budget": 400,
    "grid_cells": 6,
    "placement_chance": 1.0,
    "links": 8,
    "caches": 40,
    "relaxation": 1,
    "capture_texels": 6,
    "map_texels": 10,  # as many texels as fill no whole group of 7 or 64
}
SMALL_OF = {"surfel-cache": {"surfels": 150}}
PROFILE = replace(load_profile("iphone7"), simd_width=1)
MOTIONS = (Turn("short box", (0.1, 1.0, 0.2)), Turn("left", (0.0, 1.0, 0.0)))

COLOURS = tuple(
    Colours(name, (0, 4), ((0.2, 0.9, 0.1),) * 2, ((0.0,) * 3, (4.0, 3.0, 2.0)))
    for name in ("short box", "left")
)


@dataclass(frozen=True)
class TellingProgram(HostProgram):
    """Tells Oclgrind what the host writes into memory that it shares with the kernels.

    Nothing is released: Oclgrind 21.10 lets go of buffers before it has run what uses them, and
    takes a new one that comes to lie where a released one was for uninitialised.
    """

    KEPT: ClassVar[list[SharedBuffer]] = []

    # By kernel, which argument the host has written to since the last launch.
    WRITTEN: ClassVar[dict[str, str]] = {
        "connect": "rays",
        "shade": "vertices",
        "resolve": "blocked",
    }

    def share(self, array: np.ndarray) -> SharedBuffer:
        self.tell(shared := self.untold(array))
        return shared

    def empty(self, shape: Any, dtype: Any) -> SharedBuffer:
        return self.untold(np.empty(shape, dtype))

    def untold(self, array: np.ndarray) -> SharedBuffer:
        self.KEPT.append(shared := super().share(array))
        return shared

    def run(self, name: str, count: int, *arguments: Argument) -> None:
        if name in self.WRITTEN:
            self.tell(next(a.value for a in arguments if a.name == self.WRITTEN[name]))
        super().run(name, count, *arguments)

    def tell(self, shared: SharedBuffer) -> None:
        cl.enqueue_copy(self.queue, shared.mem, shared.array)


def bake(case: Case, cache: Path) -> None:
    """Bake a technique's scene into ``cache``."""
    baked(case, cache)


def baked(case: Case, cache: Path) -> tuple[TechniqueSpec, BakeContext, Any]:
    spec = find_technique(case.technique)
    known = spec.settings_type.__dataclass_fields__
    small = {name: value for name, value in SMALL.items() if name in known}
    small |= SMALL_OF.get(case.technique, {})
    scene = build("cornell-box")
    if case.technique == "srp":
        scene = replace(scene, probes=ProbeSettings(len(PROBES), np.array(PROBES, np.float32)))
    settings = spec.settings({**small, **case.settings})
    motion = motion_of(case, scene)
    moving = motion.triangles if motion is not None and motion.moves else None
    context = BakeContext(scene, unwrap(scene, RECEIVERS), settings, cache, moving=moving)
    # Oclgrind 21.10 keeps its shadow of memory per thread and makes the one of the thread that
    # opened the context only: any other thread that copies or runs anything crashes it.
    return spec, context, spec.bake(context, Serial())


def motion_of(case: Case, scene: Scene) -> MovingObjects | None:
    """What moves or changes in a case."""
    changes = {"moving": MOTIONS, "changing": COLOURS}.get(case.what)
    return None if changes is None else MovingObjects.of(scene, changes)


def created(
    case: Case, cache: Path, width: int, height: int
) -> tuple[Technique, list[PreparedPass]]:
    """A technique and its passes, ready for frames; in ``moving`` a box and a wall turn, in
    ``changing`` they begin to glow.
    """
    spec, context, data = baked(case, cache)
    scene = context.scene
    made = create(
        *(spec, Device(PROFILE), scene, context.lightmap, context.settings, data),
        *(case.variant, case.size, width, height, scene.cameras[0]),
        motion=motion_of(case, scene),
    )
    prepared = prepare_passes(made, case.size)
    for item in prepared:
        if item.problem:
            raise SystemExit(f"{item.name}: {item.problem}")
    return made, prepared


def frames(case: Case, cache: Path) -> None:
    """Create a technique, run some frames of it, draw its images and read its receivers."""
    ran(case, cache).indirect_irradiance()


def moving(case: Case, cache: Path) -> None:
    """Run frames of a technique on a scene that moves, and read its receivers."""
    ran(case, cache).indirect_irradiance()


def changing(case: Case, cache: Path) -> None:
    """Run frames of a technique on a scene whose materials change."""
    ran(case, cache)


def behind_the_camera(case: Case, prepared: list[PreparedPass]) -> list[PreparedPass]:
    """Passes without that of the camera, which is half of what the simulator has to do: it sees at
    rest what it saw in the frame before. Its own cases are those of ``direct``.
    """
    if case.technique == "direct" or case.what == "moving":
        return prepared
    later = [item for item in prepared if item.name != "camera"]
    assert len(later) < len(prepared)
    return later


def image_of(case: Case) -> tuple[int, int]:
    """Its width and height, pixels."""
    side = FRAMES_AND_TILES.get(case.technique, OF_OTHERS)[1]
    across, down = TILES[case.size]
    half = side // 2 + 1
    return (side + 3 if across > 1 else half), (side + 1 if down > 1 else half)


def ran(case: Case, cache: Path) -> Technique:
    """A technique after its frames; with groups that divide nothing, after its images too, which
    kernels of the frame draw but for the probes'.
    """
    count = FRAMES_AND_TILES.get(case.technique, OF_OTHERS)[0]
    made, prepared = created(case, cache, *image_of(case))
    enqueue_frame(made, prepared, 0)
    later = behind_the_camera(case, prepared)
    for frame in range(1, count):
        enqueue_frame(made, later, frame)
    if case.size == 7:
        made.images()
    return made


def roofs(case: Case, cache: Path) -> None:
    """Measure the machine's roofs, with next to nothing to do."""
    roofs_module._STREAM_BYTES = 4 * case.width * 50  # not a multiple of the items' stretch
    roofs_module._ITEMS_PER_UNIT = 8 * case.size  # groups are an eighth of that
    roofs_module._FMA_TURNS, roofs_module._LAUNCHES = 2, 1
    roofs_module._REPEATS, roofs_module._RAYS = 1, 40
    roofs_module.measure_roofs(PROFILE)
    calibration_module.REPEATS = 1
    calibration_module._CHASE_STEPS, calibration_module._CHAIN_TURNS = 40, 2
    device = Device.unlimited()
    calibration_module.chase_ns(device, 64 * case.size, 64)
    calibration_module.chain_ns(device)


def rays(case: Case, cache: Path) -> None:
    """Closest and any hits of rays, singly and in packets: alike, apart, of one limit and many."""
    traced(case, build("cornell-box"))


def cut_rays(case: Case, cache: Path) -> None:
    """The same through holes."""
    traced(case, cut_at_random(build("cornell-box"), np.random.default_rng(1)))


def traced(case: Case, scene: Scene) -> None:
    rng = np.random.default_rng(0)
    low, high = scene.bounds
    origins = rng.uniform(low, high, (100, 3)).astype(np.float32)
    directions = rng.normal(size=(100, 3)).astype(np.float32)
    alike = slice(0, 64)
    origins[alike] = (low + high) / 2
    directions[alike] = rng.normal((0.3, 0.5, -1.0), 0.05, (64, 3))
    limits = rng.uniform(0.1, 2.0, 100).astype(np.float32)
    opened = Device(PROFILE)
    cut = None if scene.cutouts is None else scene.cutouts.packed(len(scene.triangles))
    tree = DeviceBvh.upload(opened, build_bvh(scene.corners), cutouts=cut)
    for packets in (False, True):
        tracer = DeviceTracer(opened, tree, case.size, 90, packets=packets)  # two launches
        for limit in (np.inf, limits):
            tracer.closest(origins, directions, limit)
            tracer.occluded(origins, directions, limit)
        tracer.release()


def reference(case: Case, cache: Path) -> None:
    """Trace a few paths from receivers and from the camera, three bounces each."""
    paths_of(case, random_scene(np.random.default_rng(0)))


def cut_reference(case: Case, cache: Path) -> None:
    """The same through holes, some of them in lights."""
    rng = np.random.default_rng(0)
    paths_of(case, cut_at_random(random_scene(rng), rng))


def cut_frames(case: Case, cache: Path) -> None:
    """Images of direct light through holes, by single rays and packets, and rays counted."""
    scene = cut_at_random(build("cornell-box"), np.random.default_rng(1))
    width, height = image_of(case)
    frame = FrameScene(Device(PROFILE), scene, width, height, scene.cameras[0])
    for packets in (False, True):
        shown = rendered(frame, case.size, packets=packets)
        assert np.isfinite(shown).all()
    assert count_rays(frame.device, camera_launch(frame), case.size).closest == width * height


def glow_reference(case: Case, cache: Path) -> None:
    """Paths where images emit: cut into cells, and evenly."""
    rng = np.random.default_rng(0)
    paths_of(case, glowing(random_scene(rng), rng))


def bumpy_reference(case: Case, cache: Path) -> None:
    """Paths from surfaces with normal maps."""
    rng = np.random.default_rng(0)
    paths_of(case, bumpy(random_scene(rng), rng))


def bumpy_frames(case: Case, cache: Path) -> None:
    """Images of surfaces with normal maps: direct light by single rays and packets; SRP's light,
    diffuse and glossy.
    """
    rng = np.random.default_rng(1)
    scene = bumpy(build("cornell-box"), rng)
    width, height = image_of(case)
    device = Device(PROFILE)
    frame = FrameScene(device, scene, width, height, scene.cameras[0])
    signal = ReceiverSignal.create(
        FrameLightmap.upload(device, unwrap(scene, RECEIVERS)), "signal", 4
    )
    device.write(signal.map, rng.uniform(0, 1, signal.map.shape).astype(np.float32))
    hits = HitBuffer.create(device, width, height)
    maps, gloss = NormalMapTable.upload(device, scene), GlossTable.upload(device, scene)
    for packets in (False, True):
        applied = srp_application(frame, hits, signal, packets, maps, gloss if packets else None)
        for image in applied.images(case.size).values():
            assert np.isfinite(image).all()


def glow_frames(case: Case, cache: Path) -> None:
    """Images of surfaces that emit by images, by single rays and packets."""
    scene = glowing(build("cornell-box"), np.random.default_rng(1))
    width, height = image_of(case)
    frame = FrameScene(Device(PROFILE), scene, width, height, scene.cameras[0])
    for packets in (False, True):
        assert np.isfinite(rendered(frame, case.size, packets=packets)).all()


def paths_of(case: Case, scene: Scene) -> None:
    host_cl._cpu = lambda: list_devices()[0]  # the simulator does not say that it is a CPU
    held = host_cl.host_program(
        case.size,
        cutouts=scene.cutouts is not None,
        glow=scene.glow is not None,
        normal_maps=scene.normal_maps is not None,
    )
    telling = TellingProgram(held.device, held.program, held.group)
    wavefront.host_program = lambda **options: telling
    packed = pack_scene(scene, 0, normal_maps=True)
    tracer = EmbreeTracer(scene.corners, cutouts=scene.cutouts)
    plane = image_plane(Camera((0.5, 0.5, 0.9), (0.5, 0.4, 0.0)), 5, 4)
    starts = (
        ReceiverStart(pack_fragments(lightmap_of(scene, range(12)).fragments)),
        CameraStart(plane, 5, 4, indirect_only=False, plain=False),
        CameraStart(plane, 5, 4, indirect_only=True, plain=True),
    )
    for start in starts:
        mean = Wavefront(packed, tracer, start, 3).round(samples=2, seed=1)
        assert np.isfinite(mean).all()
        assert mean.max() > 0


def suit_simulator(width: int, layout: str = "wide") -> None:
    """One thread, vectors of ``width`` floats, and a layout of what is tuned."""
    os.cpu_count = lambda: 1
    Device.vector_width = property(lambda self: width)  # type: ignore[assignment]
    Device.layout = property(lambda self: layout)  # type: ignore[assignment]


def main(cache: Path, cases: list[Case]) -> None:
    """Run ``cases`` and print the kernels."""
    with recorded_kernels() as ran:
        for case in cases:
            suit_simulator(case.width, case.layout)
            # Of lists of eight rays; each of its work-items reads what all of them have counted.
            simt_blending._GROUP = case.size
            globals()[case.what](case, cache)
    print(*sorted(ran), sep="\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), [Case(**json.loads(text)) for text in sys.argv[2:]])
