r"""Images of normal maps (SRP's light of order 1) and of gloss (that, or captured probes'
prefiltered radiance) against path-traced ones.

    PYTHONPATH=.:tests python tests/support/srp_shading.py normal-maps bumpy-box --out pictures
    PYTHONPATH=.:tests python tests/support/srp_shading.py gloss glossy-box --out pictures
    PYTHONPATH=.:tests python tests/support/srp_shading.py gloss glossy-box -t light-field-probes

prints bias and relative L2 of the indirect light that the camera sees: where surfaces have a normal
map, and over the whole image; of gloss on every metal, that it alone lights. A scene is a built-in
name or a file. Direct light has no part.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from gibench.measure.plan.view import choose_camera
from gibench.measure.session.session import Session
from gibench.profiles import load_profile
from gibench.rays.embree import scene_tracer
from gibench.reference import metrics
from gibench.reference.camera import image_plane
from gibench.reference.glossy import reference_gloss
from gibench.reference.path_tracer import Reference, reference_image
from gibench.report.images import png, tone_map
from gibench.study.site import Site
from gibench.techniques.job import Job, Shot
from gibench.techniques.registry import find_technique

FRAMES = 24  # bounces have come together
ORDER_1 = {"receiver_order": 1}
NORMAL_MAPS: dict[str, dict[str, Any]] = {
    "order 7, receivers 0": {},
    "order 4, receivers 0": {"sh_order": 4},
    "order 4, receivers 1, no maps": ORDER_1,
    "order 4, receivers 1": {**ORDER_1, "normal_maps": True},
}
GLOSS: dict[str, dict[str, Any]] = {"order 4, receivers 1": {**ORDER_1, "gloss": True}}
# Prefiltered radiance of probes: of so many, and with maps of so many texels.
CAPTURED: dict[str, dict[str, Any]] = {
    f"{probes} probes, {side} texels": {
        "gloss_steps": 5,
        "probes": probes,
        "map_texels": side,
        "capture_texels": 128,
        "relit_share": 1.0,
        "far_slower": 1.0,
    }
    for probes, side in ((1, 64), (16, 32), (16, 64), (64, 64))
}


def triangles_seen(scene, camera, width, height):
    """The triangle (h, w) at every pixel's centre, -1 for none."""
    plane = image_plane(camera, width, height)
    x = 2 * (np.arange(width) + 0.5) / width - 1
    y = 1 - 2 * (np.arange(height) + 0.5) / height
    rays = plane[1] + x[None, :, None] * plane[2] + y[:, None, None] * plane[3]
    rays = rays.reshape(-1, 3).astype(np.float32)
    origins = np.broadcast_to(plane[0], rays.shape).astype(np.float32)
    return scene_tracer(scene).closest(origins, rays).triangle.reshape(height, width)


def drawn(given, site, settings):
    """The image of indirect light, once it has settled."""
    known = settings
    if given.technique == "srp":
        known = {"probes": given.probes, "transport_rays": given.rays, **settings}
    made = find_technique(given.technique).settings(known)
    shot = Shot(given.width, given.height)
    profile = load_profile("iphone7")
    job = Job(
        given.technique, made, "tuned", given.scene, profile, 64,
        receivers=given.receivers, shot=shot,
    )  # fmt: skip
    with Session.open(job, site.standing(), site.cl_device) as session:
        session.prepare(whole=True)
        for frame in range(FRAMES):
            session.frame(frame)
        return np.asarray(session.images()["indirect only"], np.float64)


def masks_of(scene, triangle, gloss):
    """What is told apart, by name."""
    if not gloss:
        bent = np.isin(triangle, scene.normal_maps.triangle)
        return {"where bent": bent, "whole": triangle >= 0}
    material = np.where(triangle >= 0, scene.material_ids[triangle], -1)
    metals = [(i, m.name) for i, m in enumerate(scene.materials) if m.metalness == 1]
    return {name: material == i for i, name in metals}


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("normal-maps", "gloss"))
    parser.add_argument("scene")
    parser.add_argument("-t", "--technique", default="srp", help="or one of captured probes: gloss")
    parser.add_argument("--out", type=Path, default=Path("pictures"))
    parser.add_argument("--cache", type=Path, default=Path("pictures"))
    parser.add_argument("--receivers", type=int, default=10_000)
    parser.add_argument("--probes", type=int)
    parser.add_argument("--rays", type=int, default=1024)
    parser.add_argument("--paths", type=int, default=512)
    parser.add_argument("--high", action="store_true", help="probes of order 7 as well")
    parser.add_argument("--width", type=int, default=240)
    parser.add_argument("--height", type=int, default=135)
    given = parser.parse_args()
    site, gloss = Site(given.cache), given.what == "gloss"
    given.out.mkdir(parents=True, exist_ok=True)
    scene = site.standing().scene(given.scene)
    camera, size = choose_camera(scene, None), (given.width, given.height)
    truth: Reference
    if gloss:
        truth = reference_gloss(scene, camera, *size, paths=given.paths)
    else:
        truth = reference_image(
            scene, camera, *size, paths=given.paths, indirect_only=True, normal_maps=True
        )
    masks = masks_of(scene, triangles_seen(scene, camera, *size), gloss)
    shown = np.any(list(masks.values()), axis=0)
    exposure = metrics.default_exposure(truth.value[shown])

    def keep(name: str, image: Any) -> None:
        seen = tone_map(np.where(shown[..., None], image, 0), exposure)
        (given.out / f"{name}.png").write_bytes(png(seen))

    keep(f"{given.what}-truth", truth.value)
    print(f"truth: mean standard error {truth.relative_error:.1%} of the mean")
    chosen = dict(NORMAL_MAPS)
    if gloss:
        chosen = dict(GLOSS if given.technique == "srp" else CAPTURED)
    if given.high:
        last = chosen["order 4, receivers 1"]
        chosen["order 7, receivers 1"] = {**last, "sh_order": 7}
    for label, settings in chosen.items():
        image = drawn(given, site, settings)
        keep(f"{given.what}-{label.replace(', ', '-').replace(' ', '-')}", image)
        for name, mask in masks.items():
            compared = image[mask], truth.value[mask], truth.stderr[mask]
            off, l2 = metrics.bias(*compared).value, metrics.relative_l2(*compared).value
            print(f"{label}; {name}: bias {off:+.1%}, relative L2 {l2:.1%}", flush=True)


if __name__ == "__main__":
    main()
