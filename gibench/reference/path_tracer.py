"""The truth: path-traced indirect irradiance at the receivers, and path-traced images.

**Indirect irradiance** is all irradiance that does not come straight from a delta light: bounced
light, light of emissive surfaces and of the environment. Cosines are taken to the interpolated
shading normal; nothing arrives from below the triangle itself, and backs of triangles are black.
With normal maps, where they are asked for, the cosine at a receiver, or at what the camera sees, is
taken to the mapped normal, and still nothing arrives from below the triangle; one that faces the
back is not used, and no later bounce uses any (``kernels_cl/common/normal_map.cl``).
Which side is the back is the triangle's winding alone: a renderer that also asks the shading normal
(Mitsuba does) is darker along the silhouettes of coarse smooth meshes.

The estimate is unbiased and unclamped. It is a mean over independent rounds, each a separately
scrambled low-discrepancy point set, so that the standard error can be read off their spread.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np

from gibench.arrays import Doubles
from gibench.errors import BadInput
from gibench.progress import progress as progress_bar
from gibench.rays.embree import scene_tracer
from gibench.rays.offset import ray_scale
from gibench.reference import store
from gibench.reference.camera import image_plane
from gibench.reference.packed import pack_fragments, pack_scene
from gibench.reference.starts import CameraStart, ReceiverStart
from gibench.reference.tiles import Tracing, traced_rounds
from gibench.reference.wavefront import Wavefront
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Camera, Scene
from gibench.work import Executor, elsewhere

Advance = Callable[[int], None]

DEFAULT_PATHS = 256
# Where a target error is given and no number of paths, this many are traced at most.
MOST_PATHS = 1 << 16
# A standard error from fewer independent rounds says little of itself (its own relative error is
# about 1 / sqrt(2 (rounds - 1)), a quarter at 8).
LEAST_ROUNDS = 8
# A round takes at most so many paths per receiver, or so many altogether: large enough for the
# point sets to pay and the waves to fill, small enough to stop and save between rounds.
_MANY_PATHS_PER_ROUND = 64
_LARGE_ROUND = 1 << 20
_SAVE_EVERY_SECONDS = 20.0
# Part of every key: raise it when the estimator changes what it computes.
_ESTIMATOR = 1


@dataclass(frozen=True)
class Reference:
    """A path-traced estimate and its uncertainty.

    Attributes:
        value: (n, 3) irradiance in W/m2, or (height, width, 3) radiance or irradiance.
        stderr: standard error of each value, same shape and unit.
        paths: paths per receiver or pixel.
        rounds: independent randomisations they come from.
        rays: rays traced in all, shadow rays included.
        seconds: time spent in all, earlier sessions included.
        ray_seconds: share of that in Embree.
        key: SHA-256 of all the estimate depends on.
    """

    value: Doubles = field(repr=False)
    stderr: Doubles = field(repr=False)
    paths: int
    rounds: int
    rays: int
    seconds: float
    ray_seconds: float
    key: str

    @property
    def relative_error(self) -> float:
        """Mean standard error over mean value."""
        mean = float(self.value.mean())
        return float(self.stderr.mean()) / mean if mean > 0 else 0.0


def reference_irradiance(
    scene: Scene,
    lightmap: Lightmap,
    *,
    frame: int = 0,
    bounces: int | None = None,
    target_error: float | None = None,
    paths: int | None = None,
    seed: int = 1,
    normal_maps: bool = False,
    store_dir: Path | None = None,
    progress: Advance | None = None,
    executor: Executor | None = None,
) -> Reference:
    """Path-traced indirect irradiance at every receiver.

    Paths start at uniformly distributed points of the receiver's covered surface.

    Args:
        scene: the scene.
        lightmap: its receivers.
        frame: the lights are where they are in this frame.
        bounces: most reflections between a light and the receiver: 0 is only what emissive
            surfaces and the environment send straight, 1 adds light reflected once, and so on;
            None is any number.
        target_error: stop once the mean standard error over the mean irradiance is this small.
        paths: per receiver, rounded up to whole rounds; 256 by default, or as many as the target
            error needs, at most 65536. More than asked for are returned when they are in the store.
        seed: of the randomisation.
        normal_maps: cosines are taken to the mapped normal where a receiver has one.
        store_dir: keep rounds here and go on from what is there; None keeps nothing.
        progress: called with the number of paths just traced; None shows a bar.
        executor: traces tiles where it has other processes; else all is traced here, with all that
            kernels and rays have. The values are the same.

    Returns:
        The irradiance, (n, 3) in W/m2 per linear RGB channel, and its standard error.

    Raises:
        BadInput: a target error, number of paths, seed or bounces that makes no sense; a lightmap
            of another scene; a scene without triangles or with negative colours.
        CannotRun: there is no OpenCL runtime for the CPU.
    """
    _check(target_error, paths, bounces, seed)
    triangle = lightmap.fragments.triangle
    if len(triangle) and int(triangle.max()) >= len(scene.triangles):
        raise BadInput("the lightmap belongs to another scene", where=scene.name)
    start = ReceiverStart(pack_fragments(lightmap.fragments))
    of_start = {"what": "irradiance", "receivers": _receivers_hash(lightmap)}
    plan = _plan(paths, target_error, start.owners)
    bent = normal_maps and scene.normal_maps is not None
    rounds, key = _traced(
        scene, start, of_start, frame, bounces, seed, plan, store_dir, progress, bent, executor
    )
    return _reference(rounds, plan, key, math.pi, rounds.mean.shape)


def reference_image(
    scene: Scene,
    camera: Camera,
    width: int,
    height: int,
    *,
    frame: int = 0,
    bounces: int | None = None,
    indirect_only: bool = False,
    irradiance: bool = False,
    target_error: float | None = None,
    paths: int | None = None,
    seed: int = 1,
    normal_maps: bool = False,
    store_dir: Path | None = None,
    progress: Advance | None = None,
    executor: Executor | None = None,
) -> Reference:
    """A path-traced image, box-filtered over each pixel; row 0 is the top.

    Args:
        scene: the scene.
        camera: one of its cameras or another.
        width: pixels.
        height: pixels.
        frame: the lights are where they are in this frame.
        bounces: as in :func:`reference_irradiance`, counted before the visible surface reflects.
        indirect_only: only what the visible surface reflects of its indirect irradiance: without
            light straight from delta lights, emission seen directly and the background.
        irradiance: irradiance at the visible surface, in W/m2, instead of radiance in W/m2/sr
            (its albedo left out); needs ``indirect_only``.
        target_error: as in :func:`reference_irradiance`, and so are the rest.
        paths: per pixel.
        seed: of the randomisation.
        normal_maps: what the camera sees is shaded with its mapped normal.
        store_dir: keep rounds here and go on from what is there.
        progress: called with the number of paths just traced; None shows a bar.
        executor: as in :func:`reference_irradiance`.

    Returns:
        The image (height, width, 3) and its standard error.

    Raises:
        BadInput: as :func:`reference_irradiance`, or a camera that makes no image.
        CannotRun: there is no OpenCL runtime for the CPU.
    """
    _check(target_error, paths, bounces, seed)
    if irradiance and not indirect_only:
        raise BadInput("an image of irradiance is of indirect light only")
    plane = image_plane(camera, width, height)
    start = CameraStart(plane, width, height, indirect_only, irradiance)
    of_start = {
        "what": f"image {width}x{height} indirect={indirect_only} irradiance={irradiance}",
        "receivers": hashlib.sha256(plane.tobytes()).hexdigest(),
    }
    plan = _plan(paths, target_error, start.owners)
    bent = normal_maps and scene.normal_maps is not None
    rounds, key = _traced(
        scene, start, of_start, frame, bounces, seed, plan, store_dir, progress, bent, executor
    )
    scale = math.pi if irradiance else 1.0
    return _reference(rounds, plan, key, scale, (height, width, 3))


@dataclass(frozen=True)
class _Plan:
    per_round: int
    rounds: int
    target_error: float | None


def _plan(paths: int | None, target_error: float | None, owners: int) -> _Plan:
    wanted = paths or (DEFAULT_PATHS if target_error is None else MOST_PATHS)
    most = max(_MANY_PATHS_PER_ROUND, _LARGE_ROUND // owners)
    per_round = 1 << int(math.log2(min(wanted // LEAST_ROUNDS, most)))
    return _Plan(per_round, -(-wanted // per_round), target_error)


def _traced(
    scene: Scene,
    start: ReceiverStart | CameraStart,
    of_start: dict[str, str],
    frame: int,
    bounces: int | None,
    seed: int,
    plan: _Plan,
    folder: Path | None,
    advance: Advance | None,
    normal_maps: bool,
    executor: Executor | None = None,
) -> tuple[store.Rounds, store.Key]:
    lights = repr(scene.lights_at(frame))
    key: store.Key = {
        **of_start,
        "estimator": _ESTIMATOR,
        "scene": scene.content_hash(),
        "lights": hashlib.sha256(lights.encode()).hexdigest(),
        "bounces": bounces,
        "seed": seed,
        "paths_per_round": plan.per_round,
    }
    if normal_maps and scene.normal_maps is not None:
        key = {**key, "normal maps": scene.normal_maps.content_hash()}
    if (scale := ray_scale(scene)) != 1.0:
        key = {**key, "ray scale": str(scale)}
    held = None if folder is None else store.load(folder, key, start.owners)
    rounds = held or store.Rounds.none(start.owners)
    if _done(rounds, plan):
        return rounds, key
    if executor is not None and elsewhere(executor):
        tracing = Tracing(scene, frame, normal_maps, start, bounces, plan.per_round)
        total = (plan.rounds - rounds.count) * start.owners * plan.per_round
        with progress_bar(f"path tracing {scene.name}", total) as bar:
            last = [time.monotonic()]

            def keep(always: bool = False) -> None:
                if folder is not None and (
                    always or time.monotonic() - last[0] > _SAVE_EVERY_SECONDS
                ):
                    store.save(folder, key, rounds)
                    last[0] = time.monotonic()

            traced_rounds(
                tracing,
                rounds,
                executor,
                seeds=lambda number: _round_seed(seed, number),
                done=lambda: _done(rounds, plan),
                most=plan.rounds,
                keep=keep,
                advance=advance or bar,
            )
        return rounds, key
    wavefront = Wavefront(
        pack_scene(scene, frame, normal_maps), scene_tracer(scene), start, bounces
    )
    wavefront.work = rounds.work
    total = (plan.rounds - rounds.count) * start.owners * plan.per_round
    with progress_bar(f"path tracing {scene.name}", total) as bar:
        saved = time.monotonic()
        while not _done(rounds, plan):
            round_seed = _round_seed(seed, rounds.count)
            rounds.add(wavefront.round(plan.per_round, round_seed, advance or bar))
            if folder is not None and time.monotonic() - saved > _SAVE_EVERY_SECONDS:
                store.save(folder, key, rounds)
                saved = time.monotonic()
    if folder is not None:
        store.save(folder, key, rounds)
    return rounds, key


def _done(rounds: store.Rounds, plan: _Plan) -> bool:
    if rounds.count < LEAST_ROUNDS:
        return False
    if plan.target_error is not None and rounds.relative_error() <= plan.target_error:
        return True
    return rounds.count >= plan.rounds


def _round_seed(seed: int, number: int) -> int:
    digest = hashlib.sha256(f"{seed}/{number}".encode()).digest()
    return int.from_bytes(digest[:4], "little")


def _reference(
    rounds: store.Rounds, plan: _Plan, key: store.Key, scale: float, shape: tuple[int, ...]
) -> Reference:
    return Reference(
        (rounds.mean * scale).reshape(shape),
        (rounds.standard_error() * scale).reshape(shape),
        rounds.count * plan.per_round,
        rounds.count,
        rounds.work.rays,
        rounds.work.seconds,
        rounds.work.ray_seconds,
        store.key_digest(key),
    )


def _receivers_hash(lightmap: Lightmap) -> str:
    """Unlike the lightmap's own hash, it covers all of the fragments that paths start on."""
    digest = hashlib.sha256(lightmap.content_hash().encode())
    for part in fields(lightmap.fragments):
        digest.update(np.ascontiguousarray(getattr(lightmap.fragments, part.name)).tobytes())
    return digest.hexdigest()


def check_paths(paths: int | None, where: str) -> None:
    """Refuse too few paths for a standard error; None is as many as it takes.

    Raises:
        BadInput: they are too few; ``where`` the number was given.
    """
    if paths is not None and paths < LEAST_ROUNDS:
        raise BadInput(
            f"{paths} paths give no standard error",
            where=where,
            mend=f"give {LEAST_ROUNDS} or more",
        )


def _check(target_error: float | None, paths: int | None, bounces: int | None, seed: int) -> None:
    if target_error is not None and not (math.isfinite(target_error) and target_error > 0):
        raise BadInput(
            f"a target error of {target_error:g} is never reached",
            where="target error",
            mend="give a relative error above 0, for instance 0.01",
        )
    check_paths(paths, "paths")
    if bounces is not None and bounces < 0:
        raise BadInput(f"{bounces} bounces", where="bounces", mend="give 0 or more, or none")
    if seed < 0:
        raise BadInput(f"a seed of {seed}", where="seed", mend="give 0 or more")
