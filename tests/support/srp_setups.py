"""SRP baked small, and set up on a device."""

from __future__ import annotations

from gibench.bake.run import run_bake
from gibench.techniques.srp import SPEC
from gibench.techniques.srp.bake.settings import SrpBakeSettings
from gibench.techniques.srp.bake.stages import Given, srp_stages
from gibench.techniques.srp.bake.transport import CHUNK_RAYS
from support.made import made
from support.shading_oracle import open_device
from support.tiny_scenes import room

VARIANTS = ("published", "tuned")
SHAPES = ("published", "wide", "simt")
"""The published variant, and the tuned one in both layouts."""


def create(bake, scene, lightmap, shape, size, settings=None, local_memory=16384, motion=None):
    """SRP on a device; ``shape`` is of ``SHAPES``, or a variant as the device prefers it."""
    layout = shape if shape in ("wide", "simt") else None
    variant = "tuned" if layout else shape
    device = open_device(local_memory=local_memory, layout=layout)
    values = {"sh_order": bake.sh_order, "receiver_order": bake.receiver_order, **(settings or {})}
    return made(
        SPEC, device, scene, lightmap, SPEC.settings(values), bake, variant, size, 24, 16,
        scene.cameras[0], motion=motion,
    )  # fmt: skip


SETTINGS = {
    "probes": 6, "relight_samples": 64, "transport_rays": 32, "cluster_size": 32, "sh_order": 2,
}  # fmt: skip


def bake(folder, report=None, seed=0, executor=None, chunk_rays=CHUNK_RAYS, **changed):
    given = Given(*room(5), SrpBakeSettings(**SETTINGS | changed), seed, chunk_rays)
    return run_bake(srp_stages(given), folder, executor, report)
