"""Bake for a technique, or run two tiny frames of it; meant to be started under Oclgrind.

Prints the name of every kernel that ran, one to a line.

Usage: python frame_under_oclgrind.py bake|frames TECHNIQUE VARIANT WORKGROUP_SIZE VECTOR_WIDTH
           CACHE_DIR
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyopencl as cl

from gibench.device import Device
from gibench.measure.enqueue import enqueue_frame, prepare_passes
from gibench.profiles import load_profile
from gibench.scene.atlas import unwrap
from gibench.scene.builtin import build
from gibench.techniques.registry import BakeContext, CreateContext, find_technique

# Enough for every kernel's loops, borders and remainders; the simulator is slow.
RECEIVERS, WIDTH, HEIGHT = 90, 18, 17
SMALL = {
    "sh_order": 2,
    "probes": 3,
    "relight_samples": 40,
    "transport_rays": 24,
    "rays": 40,
    "surfels": 300,
    "ray_budget": 400,
    "grid_cells": 6,
}


def record_kernels() -> set[str]:
    """The set that every kernel enqueued from now on is added to."""
    ran: set[str] = set()
    enqueue = cl.enqueue_nd_range_kernel

    def recording(queue: Any, kernel: Any, *args: Any, **kwargs: Any) -> Any:
        ran.add(kernel.function_name)
        return enqueue(queue, kernel, *args, **kwargs)

    call = cl.Kernel.__call__

    def calling(kernel: Any, *args: Any, **kwargs: Any) -> Any:
        ran.add(kernel.function_name)
        return call(kernel, *args, **kwargs)

    cl.enqueue_nd_range_kernel = recording
    cl.Kernel.__call__ = calling
    return ran


def main(
    what: str, technique: str, variant: str, workgroup_size: int, vector_width: int, cache: Path
) -> None:
    """Bake; then create, run two frames and draw the images, where they are asked for."""
    ran = record_kernels()
    os.cpu_count = lambda: 1  # Oclgrind crashes when kernels are enqueued from several threads
    Device.vector_width = property(lambda self: vector_width)  # type: ignore[assignment]
    spec = find_technique(technique)
    known = spec.settings_type.__dataclass_fields__
    settings = spec.settings({k: v for k, v in SMALL.items() if k in known})
    scene = build("cornell-box")
    lightmap = unwrap(scene, RECEIVERS)
    baked = spec.bake(BakeContext(scene, lightmap, settings, cache))
    if what == "bake":
        print(*sorted(ran), sep="\n")
        return
    device = Device(replace(load_profile("iphone7"), simd_width=1))
    context = CreateContext(
        *(device, scene, lightmap, settings, baked, variant, workgroup_size),
        *(WIDTH, HEIGHT, scene.cameras[0]),
    )
    made = spec.create(context)
    prepared = prepare_passes(made, workgroup_size)
    for item in prepared:
        if item.problem:
            raise SystemExit(f"{item.name}: {item.problem}")
    for frame in range(2):
        enqueue_frame(made, prepared, frame)
    made.images()
    made.indirect_irradiance()
    print(*sorted(ran), sep="\n")


if __name__ == "__main__":
    what, technique, variant, size, width, cache = sys.argv[1:]
    main(what, technique, variant, int(size), int(width), Path(cache))
