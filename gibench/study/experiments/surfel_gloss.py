"""Gloss from surfel caches against a path-traced truth (Jendersie et al. 2016, figure 6)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
import pandas as pd

from gibench.arrays import Doubles
from gibench.measure.plan.view import choose_camera
from gibench.measure.session.session import Session
from gibench.rays.embree import scene_tracer
from gibench.reference.camera import image_plane
from gibench.reference.glossy import reference_lobe
from gibench.reference.luminance import luminance
from gibench.reference.metrics import bias, default_exposure, flip, relative_l2
from gibench.report.images import tone_map
from gibench.report.plots import Picture, panel
from gibench.resources import data
from gibench.scene.model import Camera, Scene
from gibench.study.experiments.common import Context, Experiment, Measuring, Point, markdown
from gibench.study.experiments.kept import Found, Kept
from gibench.study.experiments.side_by_side import FORMATS
from gibench.study.experiments.surfel_caches import TECHNIQUE
from gibench.study.experiments.surfel_failures import AREA_LIGHT
from gibench.study.pictures import SCALE
from gibench.techniques.job import Job
from gibench.work import Worker

EXPONENT: Final = 20.0
"""Figure 6's."""
MIRRORED: Final = "mirrored direction"
HALF_VECTOR: Final = "half vector"
_AS_WIDE: Final = 4.0
"""A Blinn-Phong exponent over that of a lobe about the mirrored direction that is as wide: half
vectors turn half as much, and cos^n is about exp(-n angle^2 / 2)."""
_FRAMES: Final = 32
"""Frames after which the bounces of a room of albedo 0.7 have come together."""
_IMAGE: Final = (256, 144)
_PATHS: Final = 256
_TRUTH: Final = "truth"
_BANDS: Final[dict[str, dict[str, Any]]] = {
    "2 bands": {"sh_bands": 2},
    "3 bands": {"sh_bands": 3},
    "4 bands": {"sh_bands": 4},
    "4 bands, run time": {"sh_bands": 4, "projection": "runtime"},
}
# By the truth's lobe: its file, and what is held against it, by label.
_FILES: Final = {MIRRORED: "surfel-gloss", HALF_VECTOR: "surfel-gloss-half-vector"}
_CHOICES: Final[dict[str, dict[str, dict[str, Any]]]] = {
    MIRRORED: {label: {**choice, "exponent": EXPONENT} for label, choice in _BANDS.items()},
    HALF_VECTOR: {
        **{
            f"{label}, n = {EXPONENT / _AS_WIDE:g}": {**choice, "exponent": EXPONENT / _AS_WIDE}
            for label, choice in _BANDS.items()
        },
        f"4 bands, n = {EXPONENT:g}": {"sh_bands": 4, "exponent": EXPONENT},
    },
}


def _points(context: Context) -> Iterator[Point]:
    own = str(data("scenes") / "surfel-caches" / "stars.toml")
    scene = (context.scenes or (own,))[0]
    for lobe, choices in _CHOICES.items():
        for label, choice in choices.items():
            settings = {**AREA_LIGHT, **choice, "gloss": 1.0}
            if context.quick:
                settings |= {"surfels": 512, "links": 64, "caches": 300, "relaxation": 2}
            receivers = 1000 if context.quick else None
            job = context.of(TECHNIQUE, scene, context.profiles[0], receivers, **settings)
            yield Point({"truth": lobe, "setting": label}, job)


def _label(lobe: Any, setting: Any) -> str:
    return f"{lobe}, {setting}"


def _indirect(context: Context, job: Job, *, glossy: bool) -> Doubles:
    """The image (h, w, 3) of indirect light once its bounces have come together, W/m2/sr."""
    if not glossy:
        job = replace(job, settings=replace(job.settings, exponent=0.0))
    with Session.open(job, context.site.standing(), context.site.cl_device) as session:
        session.prepare(whole=True)
        for frame in range(_FRAMES):
            session.frame(frame)
        return np.asarray(session.images()["indirect only"], np.float64)


def floor_seen(scene: Scene, camera: Camera, width: int, height: int) -> np.ndarray[Any, Any]:
    """Pixels (h, w) whose middle shows the scene's floor: what faces up at its lowest."""
    plane = image_plane(camera, width, height)
    x = 2 * (np.arange(width) + 0.5) / width - 1
    y = 1 - 2 * (np.arange(height) + 0.5) / height
    rays = plane[1] + x[None, :, None] * plane[2] + y[:, None, None] * plane[3]
    rays = rays.reshape(-1, 3).astype(np.float32)
    origins = np.broadcast_to(plane[0], rays.shape).astype(np.float32)
    hits = scene_tracer(scene).closest(origins, rays)
    corners = scene.corners[np.maximum(hits.triangle, 0)]
    low, high = scene.bounds
    lowest = corners[:, :, 1].max(axis=1) <= low[1] + 1e-3 * (high - low)[1]
    return np.asarray((lowest & (hits.triangle >= 0)).reshape(height, width))


def _measure(context: Context, unit: Measuring, worker: Worker) -> Found:
    job = replace(unit.point.job, shot=context.shot(_IMAGE))
    size = job.shot.width, job.shot.height
    scene = context.site.standing().scene(job.scene)
    camera = choose_camera(scene, job.shot.camera)
    lobe = unit.point.key["truth"]

    def traced() -> tuple[Doubles, Doubles]:
        paths = 8 if context.quick else context.reference_paths or _PATHS
        half = lobe == HALF_VECTOR
        found = reference_lobe(scene, camera, *size, EXPONENT, half_vector=half, paths=paths)
        return found.value, found.stderr

    truth, stderr = context.site.kept(("lobe", lobe, job.scene, *size), traced)
    both, diffuse = (_indirect(context, job, glossy=glossy) for glossy in (True, False))
    gloss = np.maximum(both - diffuse, 0.0)
    floor = floor_seen(scene, camera, *size)
    off = bias(gloss[floor], truth[floor], stderr[floor])
    apart = relative_l2(gloss[floor], truth[floor], stderr[floor])
    looks = flip(gloss, truth, stderr, floor)
    row = {
        "exponent": job.settings.exponent,
        "bias": off.value,
        "rel_l2": apart.value,
        "flip": looks.value,
        "bias_noise": off.noise,
        "rel_l2_noise": apart.noise,
        "flip_noise": looks.noise,
        "pixels": int(floor.sum()),
    }
    shown = {_label(lobe, unit.point.key["setting"]): gloss, _label(lobe, _TRUTH): truth}
    arrays = {name: image.reshape(-1, 3) for name, image in shown.items()}
    return Found([row], arrays=arrays)


def _pictures(context: Context, kept: Kept, lobe: str, settings: list[str]) -> str:
    """A panel of the truth and what is held against it; the Markdown that shows it."""
    width, height = context.shot(_IMAGE).width, context.shot(_IMAGE).height
    images = {
        label: values.reshape(height, width, 3)
        for label in (_TRUTH, *settings)
        if (values := kept.array(_label(lobe, label))) is not None
    }
    truth = images[_TRUTH]
    exposure = default_exposure(truth.reshape(-1, 3))
    limit = SCALE / exposure
    above: list[Picture | None] = [
        Picture(label, tone_map(np.maximum(image, 0), exposure)) for label, image in images.items()
    ]
    below: list[Picture | None] = [
        None,
        *(
            Picture(f"{n}, minus truth", luminance(x - truth), "RdBu_r", (-limit, limit), "W/m²/sr")
            for n, x in images.items()
            if n != _TRUTH
        ),
    ]
    panel(
        kept.path / _FILES[lobe],
        [above, below],
        f"The lobe's light alone; in truth cos^{EXPONENT:g} of the angle "
        + ("to the mirrored direction" if lobe == MIRRORED else "of the half vector")
        + "; one exposure, one scale.",
    )
    return f"![gloss]({_FILES[lobe]}.png)"


def _present(context: Context, kept: Kept, table: pd.DataFrame) -> str:
    ok = table[table["status"] == "ok"]
    shown = ["truth", "setting", "bias", "rel_l2", "flip", "rel_l2_noise", "pixels"]
    pictures = [
        _pictures(context, kept, lobe, mine["setting"].tolist())
        for lobe in _CHOICES
        if not (mine := ok[ok["truth"] == lobe]).empty
    ]
    return "\n\n".join(
        (
            "The lobe's light alone, without the diffuse one's, over the floor. The technique's "
            "lobe is cos^n about the mirrored direction, of volume one; the truth's is cos^20 "
            "about it (Phong), or of the angle between normal and half vector (Blinn), which is "
            "about as wide as n = 5. Nothing in four bands is as narrow as cos^20 about the "
            "mirrored direction: they keep 1, 0.95, 0.87 and 0.76 of its own, and nothing beyond. "
            "A lamp beside the mirrored direction is smeared into it, by more bands the brighter.",
            markdown(ok[shown], {**FORMATS, "rel_l2_noise": ".2%"}),
            *pictures,
        )
    )


GLOSS = Experiment(
    name="surfel-gloss",
    title="Surfel caches: a glossy floor",
    source="figure 6 and section 3.2 of Jendersie et al. 2016",
    profiles=("iphone7",),
    keys=("truth", "setting"),
    columns=(
        *("exponent", "bias", "rel_l2", "flip"),
        *("bias_noise", "rel_l2_noise", "flip_noise", "pixels"),
    ),
    points=_points,
    measure=_measure,
    present=_present,
    timed=False,
)
