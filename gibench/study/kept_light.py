"""The light that a technique settles on, kept by all that decides it and by nothing else.

A profile binds limits: how large work-groups and buffers may be. The same kernels with the same
settings and seed come to the same light within any profile that lets them run, in sums of another
order at most. So the key of kept light holds neither the profile nor the work-group size, and
configurations that differ in these alone are settled once. A run that is repeated with the same
cache folder settles nothing anew.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Doubles
from gibench.device.build import vector_width
from gibench.files import write_whole
from gibench.resources import data
from gibench.scene.lightmap import Lightmap
from gibench.study.settle import (
    Settled,
    SettleOptions,
    refuse_motion,
    settle,
    settled_remark,
)
from gibench.study.site import Site
from gibench.techniques.job import Job
from gibench.techniques.registry import BakeContext, TechniqueSpec, find_technique, techniques
from gibench.work import Worker

_VERSION = 1
"""Raised whenever what is kept changes, or what it depends on beside the code in the key."""


@dataclass(frozen=True)
class SettledLight:
    """What a technique came to.

    Attributes:
        irradiance: (n, 3) of the last frame, W/m2, in single precision.
        covered: (n,) receivers that the technique has anything to say of.
        frames: run in all.
        settled: whether it stood still at the end.
        change: of the mean irradiance in the last doubling of frames, as a share.
        unrested: what it says where it is not at rest, though it may be.
        memory_bytes: the most that was allocated at once.
    """

    irradiance: Doubles = field(repr=False)
    covered: npt.NDArray[np.bool_] = field(repr=False)
    frames: int
    settled: bool
    change: float
    unrested: str
    memory_bytes: int

    @staticmethod
    def of(settled: Settled) -> SettledLight:
        """What is kept of ``settled``."""
        return SettledLight(
            irradiance=settled.irradiance.astype(np.float32).astype(np.float64),
            covered=settled.covered,
            frames=settled.frames,
            settled=settled.settled,
            change=settled.change,
            unrested=settled.unrested,
            memory_bytes=settled.memory_bytes,
        )

    def ended_by_itself(self, options: SettleOptions) -> bool:
        """Whether it stood still or ran all its frames. What a clock ended says how busy the
        machine was, and is asked anew by the next run.
        """
        return (self.settled and not self.unrested) or self.frames >= options.frames

    def remark(self) -> str:
        """What a reader must know of it; empty where it stood still, at rest."""
        return settled_remark(
            settled=self.settled,
            frames=self.frames,
            change=self.change,
            unrested=self.unrested,
        )


def settled_light(
    job: Job, options: SettleOptions, site: Site, worker: Worker, among: str = "", within: str = ""
) -> tuple[SettledLight, Lightmap]:
    """The light that ``job`` settles on under standing lights, from the cache where it is there.

    Args:
        job: what to run.
        options: when to stop.
        site: where.
        worker: who runs it.
        among: what it is among others, for the progress bar.
        within: what else sets it apart: the limits that it must be known to fit into, where nobody
            has seen it run within them.

    Returns:
        The light, and the receivers.

    Raises:
        CannotRun: the profile, device or budget forbids it or one of its passes.
        GibenchError: a pass failed, or the irradiance is not finite.
    """
    refuse_motion(job.shot)
    shared = site.standing()
    scene = shared.scene(job.scene)
    lightmap = shared.lightmap(job.scene, job.receivers or scene.receivers)
    key = light_key(job, options, site, lightmap, within)
    path = shared.cache_dir / f"light-{hashlib.sha256(key.encode()).hexdigest()[:32]}.npz"

    def make() -> SettledLight:
        kept = _load(path, key, len(lightmap.receivers))
        if kept is not None:
            return kept
        found = SettledLight.of(settle(job, options, shared, site.cl_device, worker, among))
        if found.ended_by_itself(options):
            _save(path, key, found)
        return found

    # What a clock ended is shared in this process, too.
    return site.kept(("light", key, options.seconds), make), lightmap


def light_key(
    job: Job, options: SettleOptions, site: Site, lightmap: Lightmap, within: str = ""
) -> str:
    """All that decides the light of ``job``, as text: its profile and work-group size do not."""
    spec, shared = find_technique(job.technique), site.standing()
    scene = shared.scene(job.scene)
    context = BakeContext(scene, lightmap, job.settings, shared.cache_dir, site.seed)
    device = site.cl_device
    parts: dict[str, Any] = {
        "version": _VERSION,
        "technique": job.technique,
        "settings": repr(job.settings),
        "variant": job.variant,
        "layout": job.layout,
        "scene": scene.content_hash(),
        "surfaces": _surfaces(scene.normal_maps, scene.gloss_maps),
        "lights": repr(scene.lights),
        "dimmer": repr(scene.dimmer),
        "receivers": lightmap.content_hash(),
        "bake": spec.bake_key(context),
        "seed": job.seed,
        "shot": asdict(job.shot),
        "until": [options.frames, options.tolerance, options.jitter],
        "device": [device.name, device.driver_version, device.platform.version],
        "vector_width": vector_width(device),
        "code": _code(job.technique),
        "within": within,
    }
    return json.dumps(parts, sort_keys=True, default=repr)


def within_limits(job: Job) -> str:
    """The profile and work-group size of ``job``, for those who do not know that it fits them."""
    return f"{job.profile.content_hash} {job.group_size}"


def _surfaces(*of_scene: Any) -> list[str]:
    return ["" if each is None else each.content_hash() for each in of_scene]


_SHARED_CODE = ("device", "measure/session", "rays", "techniques")
"""Folders. What reads scenes, unwraps and bakes is told by what came of it, which is in the key."""
_SHARED_FILES = ("scene/model.py", "study/settle.py")


@cache
def _code(technique: str) -> str:
    """SHA-256 of the code that makes the technique's light: its own, and what all share."""
    mine = _home(find_technique(technique))
    others = {_home(spec) for spec in techniques().values()} - {mine}
    digest = hashlib.sha256()
    package = files("gibench")
    folders = [package.joinpath(*name.split("/")) for name in _SHARED_CODE]
    for number, folder in enumerate((*folders, data("kernels_cl"))):
        for name, content in sorted(_sources(folder, others)):
            digest.update(f"{number} {name}\0".encode() + content + b"\0")
    for name in _SHARED_FILES:
        digest.update(package.joinpath(*name.split("/")).read_bytes())
    return digest.hexdigest()


def _home(spec: TechniqueSpec) -> str:
    """The folder, or module, that a technique's own code lies in."""
    return spec.create.__module__.split(".")[2]


def _sources(
    folder: Traversable, without: set[str], prefix: str = ""
) -> Iterator[tuple[str, bytes]]:
    for entry in folder.iterdir():
        if entry.name.split(".")[0] in without and not prefix:
            continue
        if entry.is_dir():
            yield from _sources(entry, without, f"{prefix}{entry.name}/")
        elif entry.name.endswith((".py", ".cl")):
            yield prefix + entry.name, entry.read_bytes()


def _load(path: Path, key: str, receivers: int) -> SettledLight | None:
    """What is kept under ``key``, or None where nothing is, or the file is damaged."""
    try:
        with np.load(path, allow_pickle=False) as held:
            light = held["irradiance"].astype(np.float64)
            if str(held["key"]) != key or light.shape != (receivers, 3):
                return None
            return SettledLight(
                irradiance=light,
                covered=held["covered"],
                frames=int(held["frames"]),
                settled=bool(held["settled"]),
                change=float(held["change"]),
                unrested=str(held["unrested"]),
                memory_bytes=int(held["memory_bytes"]),
            )
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _save(path: Path, key: str, light: SettledLight) -> None:
    """Keep it; a disk that refuses costs no more than settling again."""
    body = io.BytesIO()
    arrays = asdict(light) | {"irradiance": light.irradiance.astype(np.float32)}
    np.savez_compressed(body, allow_pickle=False, key=np.array(key), **arrays)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, body.getvalue())
    except OSError:
        return
