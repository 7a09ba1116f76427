"""What moves, as the probes see it (Silvennoinen and Lehtinen 2017, section 5.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gibench.device import (
    Argument,
    Buffer,
    BufferSpec,
    Device,
    Launch,
    count_rays,
    integer,
    reads,
    updates,
)
from gibench.rays.embree import scene_tracer
from gibench.scene.model import Scene
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.moving_tree import MovingTree
from gibench.techniques.srp.bake.data import SrpBake
from gibench.techniques.srp.probe_light import LambdaLayout, ProbeLight, relight_reach
from gibench.techniques.srp.resting import resting_scene
from gibench.techniques.srp.turns import ProbeTurns
from gibench.techniques.technique import Pass, Work

BLOCKED_RAYS = "blocked_rays"


@dataclass(frozen=True)
class Movers:
    """What moves, and the relight rays that it may block.

    Attributes:
        scene: the scene on the device.
        tree: over what moves.
        light: the probes' light on it.
        turns: which probes are updated.
        samples: relight rays of a probe.
        directions: (s, 3) float32 of them.
        reach: (p, s) float32 how far each goes until it meets what rests, m.
        blocked: (p, s, 4) float32 what a blocked one sees, W/m2/sr, and 1; else 0.
    """

    scene: FrameScene
    tree: MovingTree
    light: ProbeLight
    turns: ProbeTurns
    samples: int
    directions: Buffer
    reach: Buffer
    blocked: Buffer

    @staticmethod
    def create(
        device: Device, scene: FrameScene, motion: MovingObjects, bake: SrpBake, turns: ProbeTurns
    ) -> Movers:
        """What moves by ``motion``.

        Raises:
            CannotRun: it does not fit the device's profile.
        """
        rests = resting_scene(scene.scene, motion.triangles)
        tracer, relight = scene_tracer(rests), bake.relight
        probes, samples = relight.texel.shape
        held = device.allocate(
            _rays(probes, samples),
            {
                "relight_towards": relight.directions,
                "relight_reach": relight_reach(bake.probes, relight.directions, tracer),
            },
        )
        return Movers(
            scene,
            MovingTree.create(device, scene.scene, motion, scene.surfaces),
            ProbeLight.create(device, bake.probes, bake.sh_order, tracer, rests),
            turns,
            samples,
            held["relight_towards"],
            held["relight_reach"],
            held["blocked"],
        )

    @staticmethod
    def buffers(scene: Scene, motion: MovingObjects, bake: SrpBake) -> list[BufferSpec]:
        """The buffers that it takes."""
        probes, samples = bake.relight.texel.shape
        return [
            *_rays(probes, samples),
            *MovingTree.buffers(scene, motion),
            *ProbeLight.buffers(probes),
        ]

    def passes(self, radiance: Buffer, layout: LambdaLayout, bounces: bool) -> list[Pass]:
        """The passes before the probes' update: the tree refitted, and rays traced against it.

        Work counts a ray of every probe of the frame; shadow rays of what they meet are known after
        a frame.
        """
        defines = {**self.light.defines(layout), "SAMPLES": self.samples}
        program = self.scene.program("srp/blocked_rays.cl", defines)
        args: tuple[Argument, ...] = (
            *self.scene.bvh_args,
            *self.scene.surface_args,
            *self.scene.light_args,
            *self.tree.args,
            *self.light.args(radiance),
            reads("updated", self.turns.state),
            reads("directions", self.directions),
            reads("reach", self.reach),
            integer("bounces", bounces),
            updates("blocked", self.blocked),
        )

        def rays() -> int:
            return self.turns.count() * self.samples

        def launches() -> Sequence[Launch]:
            return [Launch(program, BLOCKED_RAYS, args, items=rays)]

        def work() -> Work:
            return Work(
                bytes_read=4 * rays() + 12 * self.samples,
                bytes_written=16 * rays(),
                rays=rays(),
            )

        def counted(size: int) -> Work:
            (launch,) = launches()
            found = count_rays(self.scene.device, launch, size)
            return replace(work(), rays=float(found.closest + found.occluded))

        return [*self.tree.passes(), Pass(BLOCKED_RAYS, launches, work(), counted)]


def _rays(probes: int, samples: int) -> list[BufferSpec]:
    of, f32 = BufferSpec.of, np.float32
    return [
        of("relight_towards", (samples, 3), f32),
        of("relight_reach", (probes, samples), f32),
        of("blocked", (probes, samples, 4), f32),
    ]
