"""What every receiver sends out: the pass whose result the next bounce starts from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gibench.device import Argument, Buffer, Launch, integer, reads, updates
from gibench.scene.model import DirectionalLight, SpotLight
from gibench.techniques.parts.frame_lightmap import FrameLightmap
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.receiver_signal import ReceiverSignal
from gibench.techniques.technique import Pass, Work


def lightmap_update(
    scene: FrameScene,
    receivers: FrameLightmap,
    indirect: ReceiverSignal,
    radiance: Buffer,
    bounces: bool,
) -> Pass:
    """The pass that writes every receiver's outgoing radiance.

    Its work counts one shadow ray for every receiver and light that shines on its front, lights
    as in the frame last begun, and no flops: rays are its measure.

    Args:
        scene: the scene on the device.
        receivers: its receivers.
        indirect: last frame's indirect light.
        radiance: map that is written.
        bounces: whether ``indirect`` counts.
    """
    count = len(receivers.lightmap.receivers)

    def launches() -> Sequence[Launch]:
        program = scene.program("parts/lightmap_update.cl", indirect.macros)
        args: tuple[Argument, ...] = (
            *scene.bvh_args,
            *scene.light_args,
            reads("position", receivers.position),
            reads("normal", receivers.normal),
            reads("albedo", receivers.albedo),
            reads("emission", receivers.emission),
            reads("texel", receivers.texel),
            integer("count", count),
            reads("indirect", indirect.map),
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
