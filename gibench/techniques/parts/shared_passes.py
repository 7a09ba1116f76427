"""Passes that more than one technique runs: moving objects, lightmap update, dilation, forward
render.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gibench.device import Argument, Buffer, Launch, ProgramSpec, integer, reads, updates
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import DirectionalLight, SpotLight
from gibench.techniques.parts.frame_lightmap import FrameLightmap, border_texels
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.technique import Pass, Technique, Work


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
