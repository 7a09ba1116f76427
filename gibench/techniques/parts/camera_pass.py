"""The camera's pass, the same for every technique, and the lookup of indirect light after it.

What the camera sees of a scene (primary rays, direct light) is no part of what a technique costs:
it is a pass of its own, of the stage ``camera``. The lookup at each pixel is the technique's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gibench.device import (
    Argument,
    Buffer,
    Device,
    Launch,
    ProgramSpec,
    count_rays,
    integer,
    reads,
    updates,
    writes,
)
from gibench.rays.device_bvh import LEAST_PACKET, packet_rays
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gbuffer import HitBuffer, Kept
from gibench.techniques.parts.macros import (
    GBUFFER_FLOATS,
    GBUFFER_HIT,
    GBUFFER_NONE,
    SHOW_DIRECT,
    SHOW_INDIRECT,
    tiled_pixels,
)
from gibench.techniques.parts.normal_map_table import NO_NORMAL_MAPS, NormalMapTable
from gibench.techniques.technique import CAMERA, FloatArray, Pass, Work

CAMERA_PASS = "camera"
"""The pass's name and its kernel's."""

APPLICATION = "application"
"""The name of the pass that looks indirect light up at every pixel, and its kernel's."""

# A power of two, up to a tile's: with a lightmap 16 pixels take 4.4 ns each, one 9.8 (CPU time of
# all threads on PoCL, Cornell Box, 1334 x 750).
_LOOKUP_PIXELS = 16

_REFLECT_FLOPS = 3 * 3
"""``with_reflected`` of kernels_cl/common/shade.cl: three channels, of which each is scaled, scaled
and added."""


def suits_packets(device: Device) -> bool:
    """Whether tuned passes trace packets of rays on ``device``: where its vectors are wide."""
    return device.vector_width >= LEAST_PACKET


def camera_launch(
    scene: FrameScene,
    kept: Kept | None = None,
    image: Buffer | None = None,
    packets: bool = False,
    normal_maps: NormalMapTable = NO_NORMAL_MAPS,
) -> Launch:
    """The launch that draws what the camera sees without indirect light.

    Args:
        scene: the scene on the device.
        kept: what of the pixels is kept besides; nothing by default.
        image: that is drawn, W/m2/sr; the scene's by default.
        packets: trace as many rays together as a vector holds (see :func:`suits_packets`).
        normal_maps: that surfaces are shaded with; none by default.
    """
    packet = packet_rays(scene.device) if packets else 1
    defines = {"GBUFFER": GBUFFER_NONE if kept is None else kept.layout, **normal_maps.defines}
    if packets:
        defines["PACKET"] = packet
    source = "parts/camera_packet.cl" if packets else "parts/camera.cl"
    args: tuple[Argument, ...] = (
        *scene.bvh_args,
        *scene.surface_args,
        *scene.light_args,
        *scene.environment_args,
        *scene.camera_args,
        *(() if kept is None else kept.args),
        writes("image", scene.image if image is None else image),
        *normal_maps.args,
    )
    items = tiled_pixels(scene.width, scene.height) // packet
    return Launch(scene.program(source, defines), CAMERA_PASS, args, items=items)


def camera_pass(
    scene: FrameScene,
    kept: Kept | None = None,
    image: Buffer | None = None,
    packets: bool = False,
    normal_maps: NormalMapTable = NO_NORMAL_MAPS,
) -> Pass:
    """The pass that draws what the camera sees without indirect light (see :func:`camera_launch`).

    Its work counts the primary rays, which are certain; after a frame also the shadow rays and what
    is kept of surfaces, which depend on what the camera sees and where the lights are. No flops:
    rays are its measure.
    """
    pixels = scene.width * scene.height
    work = Work(bytes_written=12 * pixels, rays=pixels)

    def launches() -> Sequence[Launch]:
        return [camera_launch(scene, kept, image, packets, normal_maps)]

    def counted(workgroup_size: int) -> Work:
        written = work.bytes_written + (0.0 if kept is None else kept.bytes_written())
        rays = work.rays + _shadow_rays(scene, workgroup_size, normal_maps)
        return replace(work, bytes_written=written, rays=rays)

    return Pass(CAMERA_PASS, launches, work, counted, CAMERA)


def _shadow_rays(scene: FrameScene, workgroup_size: int, normal_maps: NormalMapTable) -> float:
    """Shadow rays where the camera's hit, in the frame last begun; overwrites the scene's image."""
    launch = camera_launch(scene, normal_maps=normal_maps)
    return float(count_rays(scene.device, launch, workgroup_size).occluded)


def rendered(scene: FrameScene, workgroup_size: int, packets: bool = False) -> FloatArray:
    """What the camera sees without indirect light, drawn once more, (h, w, 3) W/m2/sr."""
    return _drawn(scene, camera_launch(scene, packets=packets), workgroup_size)


@dataclass(frozen=True)
class Application:
    """A technique's indirect light on what the camera sees (kernels_cl/parts/apply.cl).

    Attributes:
        scene: the scene on the device; the light is added to its image.
        hits: what the camera pass kept.
        program: that holds the technique's lookup, with :func:`lookup_defines`.
        args: what its lookup reads: LOOKUP_PARAMS.
        flops: of a lookup.
        packets: whether the camera pass traces packets.
        normal_maps: that the camera pass shades with.
    """

    scene: FrameScene
    hits: HitBuffer
    program: ProgramSpec
    args: Sequence[Argument]
    flops: float
    packets: bool = False
    normal_maps: NormalMapTable = NO_NORMAL_MAPS

    def launch(self, show: int = SHOW_DIRECT | SHOW_INDIRECT) -> Launch:
        """The launch that applies it to an image of direct light; the sum of ``show`` is left."""
        args: tuple[Argument, ...] = (
            *self.args,
            *self.scene.camera_args,
            reads("gbuffer", self.hits.buffer),
            integer("show", show),
            updates("image", self.scene.image),
        )
        pixels = pixels_per_item(self.scene.device)
        items = tiled_pixels(self.scene.width, self.scene.height) // pixels
        return Launch(self.program, APPLICATION, args, items=items)

    def passes(self) -> list[Pass]:
        """The camera's pass and the lookup.

        The lookup's work counts every pixel's hit once; what it looks up is shared between pixels
        and not counted. How many pixels show a surface is known after a frame.
        """
        kept = Work(bytes_read=4 * self.hits.pixels)

        def counted(workgroup_size: int) -> Work:
            surfaces = self.hits.surfaces()
            return Work(
                flops=surfaces * (self.flops + _REFLECT_FLOPS),
                bytes_read=kept.bytes_read + surfaces * 4 * (GBUFFER_FLOATS - 1 + 3),
                bytes_written=surfaces * 4 * 3,
            )

        return [
            camera_pass(self.scene, self.hits, packets=self.packets, normal_maps=self.normal_maps),
            Pass(APPLICATION, lambda: [self.launch()], kept, counted),
        ]

    def images(self, workgroup_size: int) -> dict[str, FloatArray]:
        """The frame, its direct and its indirect part, drawn with the device's present state,
        (h, w, 3) W/m2/sr. The frame is left on the device.
        """
        scene = self.scene
        launch = camera_launch(scene, self.hits, packets=self.packets, normal_maps=self.normal_maps)
        direct = _drawn(scene, launch, workgroup_size)
        frame = _drawn(scene, self.launch(), workgroup_size)
        indirect = _drawn(scene, self.launch(SHOW_INDIRECT), workgroup_size)
        scene.device.write(scene.image, frame)
        return {"frame": frame, "direct only": direct, "indirect only": indirect}


def pixels_per_item(device: Device) -> int:
    """Pixels that a work-item of the lookup does: one after the other where a device has explicit
    vectors, as PoCL, on which one for each would take twice as long; else one.
    """
    return _LOOKUP_PIXELS if device.vector_width > 1 else 1


def lookup_defines(device: Device) -> dict[str, int]:
    """Macros of a program that includes kernels_cl/parts/apply.cl."""
    return {"GBUFFER": GBUFFER_HIT, "PIXELS": pixels_per_item(device)}


def _drawn(scene: FrameScene, launch: Launch, workgroup_size: int) -> FloatArray:
    scene.device.enqueue(launch, workgroup_size)
    return scene.device.read(scene.image)
