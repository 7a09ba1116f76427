"""SRP baked small, and set up on a device."""

from __future__ import annotations

from gibench.techniques.srp import SPEC
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.stages import bake_srp
from support.made import made
from support.shading_oracle import open_device
from support.tiny_scenes import room

VARIANTS = ("published", "tuned")


def create(bake, scene, lightmap, variant, size, settings=None, local_memory=16384):
    device = open_device(local_memory=local_memory)
    values = {"sh_order": bake.sh_order, **(settings or {})}
    return made(
        SPEC, device, scene, lightmap, SPEC.settings(values), bake, variant, size, 24, 16,
        scene.cameras[0],
    )  # fmt: skip


SETTINGS = {
    "probes": 6, "relight_samples": 64, "transport_rays": 32, "cluster_size": 32, "sh_order": 2,
}  # fmt: skip


def bake(folder, report=None, seed=0, **changed):
    scene, lightmap = room(5)
    return bake_srp(scene, lightmap, SrpBakeSettings(**SETTINGS | changed), folder, seed, report)
