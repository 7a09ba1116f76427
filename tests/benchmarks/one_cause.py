"""One cause at a time: a technique's bias and error on a scene, with one setting changed.

    python tests/benchmarks/one_cause.py SCENE TECHNIQUE [SETTING=VALUE[,SETTING=VALUE] ...]

Every argument after the technique is a configuration beside the default one.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from support.scaled import scaled

from gibench.measure.plan.grid import grid
from gibench.profiles import load_profile
from gibench.scene.environment import Environment
from gibench.scene.model import DirectionalLight, Scene
from gibench.study.errors import errors, errors_among
from gibench.study.frozen import FrozenShared
from gibench.study.quality import group_of
from gibench.study.quality_rows import QualityOptions
from gibench.study.settle import SettleOptions, settle
from gibench.study.site import Site
from gibench.techniques.camera_path import FlightOptions
from gibench.techniques.job import Job, Shot
from gibench.techniques.registry import find_technique
from gibench.work import Worker

CACHE = Path("/tmp/gibench-one-cause")


def job_of(scene: str, technique: str, text: str, receivers: int, shot: Shot) -> Job:
    """The job of a configuration as typed; ``-`` is the default one."""
    values = dict(pair.split("=", 1) for pair in text.split(";") if "=" in pair)
    (job,) = grid(
        [load_profile("vega56")],
        [find_technique(technique)],
        scenes=(scene,),
        settings={technique: {name: (value,) for name, value in values.items()}},
        receivers=(receivers,),
        shot=shot,
    )
    return job


@dataclass
class Lit(FrozenShared):
    """Scenes with other light: ``sun``, W/m2/sr of one texel in 128 x 64 of the sky, instead of all
    their lights; all light times ``factor``; all lengths times ``scale``.
    """

    sun: float = 0.0
    factor: float = 1.0
    scale: float = 1.0
    _made: dict[str, Scene] = field(default_factory=dict)

    def scene(self, name_or_path: str) -> Scene:
        """The scene in its other light."""
        if name_or_path not in self._made:
            found = super().scene(name_or_path)
            if self.sun:
                sky = np.full((64, 128, 3), 1.0, np.float32)
                sky[16, 40] = self.sun
                found = replace(found, lights=(), environment=Environment(sky))
            if self.factor != 1.0:
                lights = tuple(_brighter(light, self.factor) for light in found.lights)
                sky = found.environment.pixels * np.float32(self.factor)
                found = replace(found, lights=lights, environment=Environment(sky))
            if self.scale != 1.0:
                found = scaled(found, self.scale)
            self._made[name_or_path] = found
        return self._made[name_or_path]


def _brighter(light: Any, factor: float) -> Any:
    name = "irradiance" if isinstance(light, DirectionalLight) else "intensity"
    return replace(light, **{name: tuple(factor * v for v in getattr(light, name))})


def main(scene: str, technique: str, *configurations: str) -> None:
    """Print a line for each configuration."""
    receivers, frames, image = 3000, 512, (32, 18)
    extra: list[str] = []
    flight, lit = FlightOptions(), {}
    for text in configurations:
        if text.startswith("--receivers="):
            receivers = int(text.partition("=")[2])
        elif text.startswith("--frames="):
            frames = int(text.partition("=")[2])
        elif text.startswith("--image="):
            width, height = text.partition("=")[2].split("x")
            image = int(width), int(height)
        elif text.startswith(("--sun=", "--factor=", "--scale=")):
            name, _, value = text[2:].partition("=")
            lit[name] = float(value)
        elif text.startswith("--flight="):
            flight = FlightOptions("flight", 0, int(text.partition("=")[2]))
        else:
            extra.append(text)
    shared, site = Lit(CACHE, 0, **lit), Site(CACHE)
    site.kept(("standing", 0), lambda: shared)
    options = QualityOptions(SettleOptions(frames), target_error=0.03, flip=False)
    for text in ("-", *extra):
        job = job_of(scene, technique, text, receivers, Shot(*image, flight=flight))
        group = group_of(job, options, site)
        begin = time.process_time()
        settled = settle(job, options.settle, shared, site.cl_device, Worker())
        spent = time.process_time() - begin
        found = errors(group.truth, settled.irradiance, {}, with_flip=False)["whole"]
        covered = errors_among(group.truth, settled.irradiance, settled.covered)
        print(
            f"{scene} {technique} {text}: bias {100 * found['bias'].value:+.1f} % "
            f"(+-{100 * found['bias'].noise:.1f}, covered {100 * covered['bias'].value:+.1f}), "
            f"rel L2 {100 * found['rel_l2'].value:.1f} %, "
            f"{settled.frames} frames{'' if settled.settled else ' (not settled)'}, "
            f"uncovered {100 * (~settled.covered).mean():.0f} %, {settled.counts}, "
            f"{settled.memory_bytes / 2**20:.0f} MiB, {spent:.0f} CPU s",
            flush=True,
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
