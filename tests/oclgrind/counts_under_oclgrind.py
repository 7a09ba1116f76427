"""Run one pass of a technique after a whole frame; meant for ``oclgrind --inst-counts``.

Prints ``PASS name`` before each pass's launches run once more, and its declared work. With one
work-item's vector a float wide, so that instruction counts are operation counts.

Usage: python counts_under_oclgrind.py TECHNIQUE VARIANT WORKGROUP_SIZE CACHE_DIR PASS...
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, replace
from pathlib import Path

from gibench.device import Device
from gibench.measure.enqueue import enqueue_frame, prepare_passes
from gibench.profiles import load_profile
from gibench.scene.atlas import unwrap
from gibench.scene.builtin import build
from gibench.techniques.registry import BakeContext, CreateContext, find_technique

RECEIVERS, WIDTH, HEIGHT = 300, 8, 8
SMALL = {"sh_order": 3, "probes": 4, "relight_samples": 64, "transport_rays": 32}


def main(technique: str, variant: str, size: int, cache: Path, names: list[str]) -> None:
    """Bake, create, run one frame, then each pass by itself."""
    Device.vector_width = property(lambda self: 1)  # type: ignore[assignment]
    spec = find_technique(technique)
    known = spec.settings_type.__dataclass_fields__
    settings = spec.settings({k: v for k, v in SMALL.items() if k in known})
    scene = build("cornell-box")
    lightmap = unwrap(scene, RECEIVERS)
    baked = spec.bake(BakeContext(scene, lightmap, settings, cache))
    device = Device(replace(load_profile("iphone7"), simd_width=1))
    made = spec.create(
        CreateContext(
            *(device, scene, lightmap, settings, baked, variant, size),
            *(WIDTH, HEIGHT, scene.cameras[0]),
        )
    )
    prepared = prepare_passes(made, size)
    enqueue_frame(made, prepared, 0)
    made.begin_frame(1)
    for item in prepared:
        if item.name in names:
            print("PASS", item.name, json.dumps(asdict(item.work)), flush=True)
            for launch in item.launches:
                launch.enqueue(device.queue)
                device.queue.finish()
    print("END", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), Path(sys.argv[4]), sys.argv[5:])
