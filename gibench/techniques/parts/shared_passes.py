"""Passes that more than one technique runs: moving objects, lightmap update, dilation, forward
render.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

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
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import DirectionalLight, SpotLight
from gibench.techniques.parts.frame_lightmap import FrameLightmap, border_texels
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.macros import SHOW_DIRECT, SHOW_INDIRECT, tiled_pixels
from gibench.techniques.technique import (
    CAMERA,
    CAMERA_AND_GI,
    FloatArray,
    Pass,
    Stage,
    Technique,
    Work,
)


def frame_passes(technique: Technique) -> list[Pass]:
    """All passes of a frame in order: first those that move the scene's objects, which every
    technique with a :class:`FrameScene` called ``scene`` gets from it, then the technique's own.
    """
    scene = getattr(technique, "scene", None)
    moved = scene.passes() if isinstance(scene, FrameScene) else []
    return [*moved, *technique.passes()]


def lightmap_update(
    scene: FrameScene, receivers: FrameLightmap, indirect: Buffer, radiance: Buffer, bounces: bool
) -> Pass:
    """The pass that writes every receiver's outgoing radiance.

    Its work counts one shadow ray for every receiver and light that shines on its front, lights
    as in the frame last begun, and no flops: rays are its measure.

    Args:
        scene: the scene on the device.
        receivers: its receivers.
        indirect: map of last frame's indirect irradiance.
        radiance: map that is written.
        bounces: whether ``indirect`` counts.
    """
    count = len(receivers.lightmap.receivers)

    def launches() -> Sequence[Launch]:
        program = scene.program("parts/lightmap_update.cl")
        args: tuple[Argument, ...] = (
            *scene.bvh_args,
            *scene.light_args,
            reads("position", receivers.position),
            reads("normal", receivers.normal),
            reads("albedo", receivers.albedo),
            reads("emission", receivers.emission),
            reads("texel", receivers.texel),
            integer("count", count),
            reads("indirect", indirect),
            integer("bounces", bounces),
            updates("radiance", radiance),
        )
        return [Launch(program, "lightmap_update", args, items=count)]

    work = Work(
        bytes_read=count * (4 * 13 + (12 if bounces else 0)),
        bytes_written=count * 16,
        rays=lit_pairs(scene, receivers),
    )

    def counted(workgroup_size: int) -> Work:
        return replace(work, rays=lit_pairs(scene, receivers))

    return Pass("lightmap_update", launches, work, counted)


def lit_pairs(scene: FrameScene, receivers: FrameLightmap) -> int:
    """Pairs of a receiver and a light that shines on its front, whatever may lie between, lights as
    in the frame last begun.
    """
    r = receivers.lightmap.receivers
    pairs = 0
    for light in scene.scene.lights_at(scene.frame):
        if isinstance(light, DirectionalLight):
            towards = -np.broadcast_to(np.asarray(light.direction, np.float32), r.position.shape)
            power = light.irradiance
        else:
            towards = np.asarray(light.position, np.float32) - r.position
            power = light.intensity
        lit = np.einsum("ij,ij->i", towards, r.normal) > 0
        if isinstance(light, SpotLight):
            axis = np.asarray(light.direction, np.float32)
            within = -(towards @ axis) > math.cos(light.outer_angle) * np.linalg.norm(
                towards, axis=1
            )
            lit &= within
        pairs += int(np.count_nonzero(lit)) if any(power) else 0
    return pairs


def dilate(receivers: FrameLightmap, target: Buffer, border: Buffer | None = None) -> Pass:
    """The pass that extends a map's valid texels by one, in place.

    Args:
        receivers: whose map it is.
        target: the map.
        border: the texels to fill (``border_texels``, uploaded), or None to look at all of them,
            as published.
    """
    shown = (
        updates("map", target),
        integer("width", receivers.lightmap.width),
        integer("height", receivers.lightmap.height),
    )

    def launches() -> Sequence[Launch]:
        program = ProgramSpec("parts/dilate.cl")
        if border is None:
            return [Launch(program, "dilate", shown, items=receivers.texels)]
        count = border.shape[0]
        args = (*shown, reads("border", border), integer("count", count))
        return [Launch(program, "dilate_border", args, items=count)]

    filled, read, pairs = dilated_texels(receivers.lightmap)
    work = Work(flops=3 * (pairs + filled), bytes_read=12 * read, bytes_written=12 * filled)
    return Pass("dilate", launches, work)


def dilated_texels(lightmap: Lightmap) -> tuple[int, int, int]:
    """Texels that dilation fills, valid texels that it reads, and pairs of the two."""
    valid = np.zeros((lightmap.height + 2, lightmap.width + 2), np.bool_)
    filled = np.zeros_like(valid)
    across = lightmap.width
    for map_, texels in ((valid, lightmap.receivers.texel), (filled, border_texels(lightmap))):
        map_[texels // across + 1, texels % across + 1] = True
    read, pairs = np.zeros_like(valid), 0
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            met = valid & np.roll(filled, (dy, dx), (0, 1))
            read |= met
            pairs += int(np.count_nonzero(met))
    return int(np.count_nonzero(filled)), int(np.count_nonzero(read)), pairs


def forward_launch(
    scene: FrameScene,
    receivers: FrameLightmap | None = None,
    indirect: Buffer | None = None,
    show: int = SHOW_DIRECT | SHOW_INDIRECT,
    packets: bool = False,
) -> Launch:
    """The launch that renders the camera image.

    Args:
        scene: the scene on the device; its ``image`` is written.
        receivers: needed with ``indirect``.
        indirect: dilated map of indirect irradiance; None for direct light only.
        show: sum of SHOW_DIRECT and SHOW_INDIRECT.
        packets: trace as many rays together as a vector holds (see :func:`suits_packets`).
    """
    source = "parts/forward_packet.cl" if packets else "parts/forward_render.cl"
    packet = packet_rays(scene.device) if packets else 1
    defines = {"INDIRECT": int(indirect is not None)}
    if packets:
        defines["PACKET"] = packet
    program = scene.program(source, defines)
    lookup: tuple[Argument, ...] = ()
    if indirect is not None and receivers is not None:
        lookup = (
            reads("lightmap_uvs", receivers.uvs),
            reads("irradiance_map", indirect),
            integer("lightmap_width", receivers.lightmap.width),
            integer("lightmap_height", receivers.lightmap.height),
        )
    args = (
        *scene.bvh_args,
        *scene.surface_args,
        *scene.light_args,
        *scene.environment_args,
        *scene.camera_args,
        integer("show", show),
        *lookup,
        writes("image", scene.image),
    )
    items = tiled_pixels(scene.width, scene.height) // packet
    return Launch(program, "forward_render", args, items=items)


def suits_packets(device: Device) -> bool:
    """Whether tuned passes trace packets of rays on ``device``: where its vectors are wide."""
    return device.vector_width >= LEAST_PACKET


def forward_render(
    scene: FrameScene,
    receivers: FrameLightmap | None = None,
    indirect: Buffer | None = None,
    packets: bool = False,
) -> Pass:
    """The pass that renders the camera image (see :func:`forward_launch`).

    Its work counts the primary rays, which are certain; after a frame also the shadow rays, whose
    number depends on what the camera sees and where the lights are. No flops: rays are its measure.
    """
    pixels = scene.width * scene.height
    work = Work(bytes_written=12 * pixels, rays=pixels)

    def launches() -> Sequence[Launch]:
        return [forward_launch(scene, receivers, indirect, packets=packets)]

    stage: Stage = CAMERA if indirect is None else CAMERA_AND_GI
    return Pass("forward_render", launches, work, with_shadow_rays(scene, work), stage)


def with_shadow_rays(scene: FrameScene, work: Work) -> Callable[[int], Work]:
    """``Pass.counted`` of a pass that traces primary rays, which ``work`` has, and shadow rays
    where they hit; overwrites the image.
    """

    def counted(workgroup_size: int) -> Work:
        launch = forward_launch(scene, show=SHOW_DIRECT)
        rays = count_rays(scene.device, launch, workgroup_size)
        return replace(work, rays=work.rays + rays.occluded)

    return counted


def rendered(
    scene: FrameScene,
    workgroup_size: int,
    show: int,
    receivers: FrameLightmap | None = None,
    indirect: Buffer | None = None,
    packets: bool = False,
) -> FloatArray:
    """Render the camera image once more with the device's present state, (h, w, 3) W/m2/sr."""
    launch = forward_launch(scene, receivers, indirect, show, packets)
    scene.device.enqueue(launch, workgroup_size)
    return scene.device.read(scene.image)
