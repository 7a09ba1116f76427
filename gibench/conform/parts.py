"""The kernels that every technique shares, against float64 NumPy and Embree."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.device import LAYOUTS, Device, Layout
from gibench.techniques.parts.camera_pass import camera_launch
from gibench.techniques.parts.conformance.case import (
    Bench,
    Case,
    Tolerance,
    at_least,
    off,
    run,
)
from gibench.techniques.parts.conformance.shading import direct_irradiance, render
from gibench.techniques.parts.conformance.synthetic import random_lightmap, random_scene
from gibench.techniques.parts.frame_lightmap import FrameLightmap, border_texels
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.lightmap_lookup import lightmap_application
from gibench.techniques.parts.lightmap_update import lightmap_update
from gibench.techniques.parts.macros import SHOW_DIRECT, SHOW_INDIRECT
from gibench.techniques.parts.receiver_signal import ReceiverSignal
from gibench.techniques.parts.scan import BlockScan, WaveScan

SENT = Tolerance(2e-4, 2e-5)
"""Light that receivers send: what rounding does to cosines of grazing light."""
DILATED = Tolerance(10 * 2.0**-24)
"""A mean of eight: seven additions, a division and the rounding of what is added, of positive
values."""


def _image(bench: Bench, rng: np.random.Generator, size: int, packets: bool) -> Iterator[float]:
    """What the camera sees: direct light, and irradiance looked up in a lightmap."""
    scene = random_scene(rng)
    lightmap = random_lightmap(rng, scene, 200, 23, 17)
    values = rng.uniform(0, 2, (17, 23, 4)).astype(np.float32)
    width, height, frame = 41, 27, 31
    expected = render(scene, frame, width, height, lightmap, values[..., :3].astype(np.float64))
    yield at_least(float(expected.certain.mean()), 0.85)
    device = bench.open()
    shared = FrameScene(device, scene, width, height, scene.cameras[0])
    receivers = FrameLightmap.upload(device, lightmap)
    signal = ReceiverSignal.create(receivers, "signal")
    device.write(signal.map, values.reshape(-1, 4))
    hits = HitBuffer.create(device, width, height)
    applied = lightmap_application(shared, hits, signal, packets)
    shared.begin_frame(frame)
    for show, image in (
        (SHOW_DIRECT, expected.direct),
        (SHOW_DIRECT | SHOW_INDIRECT, expected.direct + expected.indirect),
    ):
        run(device, [camera_launch(shared, hits, packets=packets)], size)
        if show != SHOW_DIRECT:
            run(device, [applied.launch(show)], size)
        found = device.read(shared.image)
        yield off(found[expected.certain], image[expected.certain], 3e-4, 3e-5)


def _lightmap(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Light sent from the receivers."""
    scene = random_scene(rng)
    lightmap = random_lightmap(rng, scene, 333, 25, 40)
    device = bench.open()
    shared = FrameScene(device, scene, 8, 8, scene.cameras[0])
    receivers = FrameLightmap.upload(device, lightmap)
    last = rng.uniform(0, 2, (1000, 4)).astype(np.float32)
    indirect = ReceiverSignal.create(receivers, "last")
    device.write(indirect.map, last)
    radiance = receivers.new_map("radiance")
    shared.begin_frame(100)
    run(device, lightmap_update(shared, receivers, indirect, radiance, True).launches(), size)
    r = lightmap.receivers
    normal = r.normal.astype(np.float64)
    lit = direct_irradiance(scene, 100, r.position, normal, normal)
    expected = r.emission + r.albedo / np.pi * (lit.irradiance + last[r.texel, :3])
    found = device.read(radiance)
    yield at_least(float(lit.certain.mean()), 0.85)
    yield off(found[r.texel[lit.certain], :3], expected[lit.certain], SENT.relative, SENT.absolute)
    outside = np.setdiff1d(np.arange(1000), r.texel)
    yield off(found[outside], np.zeros_like(found[outside]))


def _dilate(bench: Bench, rng: np.random.Generator, size: int, listed: bool) -> Iterator[float]:
    """Texels around receivers take the mean of those."""
    lightmap = random_lightmap(rng, random_scene(rng, 4), 70, 19, 23)
    device = bench.open()
    signal = ReceiverSignal.create(FrameLightmap.upload(device, lightmap), "signal")
    values = device.read(signal.map)
    values[signal.entries, :3] = rng.uniform(0, 3, (70, 3))
    device.write(signal.map, values)
    border = device.upload("border", border_texels(lightmap)) if listed else None
    run(device, signal.dilate(border).launches(), size)
    source = values.reshape(23, 19, 4).astype(np.float64)
    expected = source.copy()
    for y, x in np.argwhere(source[..., 3] == 0):
        near = source[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2].reshape(-1, 4)
        if (near[:, 3] > 0).any():
            expected[y, x, :3] = near[near[:, 3] > 0, :3].mean(axis=0)
    yield off(device.read(signal.map).reshape(23, 19, 4), expected, DILATED.relative)


def _sums(values: npt.NDArray[np.uint32]) -> npt.NDArray[Any]:
    sums = np.zeros(len(values) + 1, np.uint64)
    np.cumsum(values, out=sums[1:])
    return sums & 0xFFFFFFFF


def _waves(bench: Bench, rng: np.random.Generator, size: int) -> Iterator[float]:
    """Prefix sums by waves."""
    for length in (1, 33, 257, 4097):
        device, values = bench.open(), rng.integers(0, 4000, length, dtype=np.uint32)
        scan = WaveScan.create(device, "scan", length, size)
        prefix = device.empty("prefix", length, np.uint32)
        run(device, scan.launches(device.upload("values", values), prefix), size)
        yield off(device.read(prefix), _sums(values)[:-1])


def _blocks(bench: Bench, rng: np.random.Generator, size: int, layout: Layout) -> Iterator[float]:
    """Prefix sums by blocks, of fewer values than there is room for."""
    for length in (1, 33, 257, 4097):
        device, values = bench.open(layout=layout), rng.integers(0, 4000, length, dtype=np.uint32)
        room = np.full(length + 50, 0xFFFFFFFF, np.uint32)
        room[:length] = values
        yield off(_block_sums(device, room, length, size), _sums(values))


def _block_sums(device: Device, room: Any, length: int, size: int) -> Any:
    scan = BlockScan.create(device, "scan", len(room), size)
    count = device.upload("length", np.array([length], np.uint32))
    prefix = device.empty("prefix", len(room) + 1, np.uint32)
    source = device.upload("values", room)
    run(device, scan.launches(source, count, prefix, lambda: length), size)
    return device.read(prefix)[: length + 1]


_LOOKUP = "parts/apply.cl:application"
CASES = [
    Case(
        "Camera and lightmap lookup, single rays",
        ("parts/camera.cl:camera", _LOOKUP),
        partial(_image, packets=False),
        (7, 64),
    ),
    Case(
        "Camera and lightmap lookup, packets",
        ("parts/camera_packet.cl:camera", _LOOKUP),
        partial(_image, packets=True),
        (7, 64),
    ),
    Case("Lightmap update", ("parts/lightmap_update.cl:lightmap_update",), _lightmap),
    Case("Dilation", ("parts/dilate.cl:dilate",), partial(_dilate, listed=False)),
    Case(
        "Dilation of listed texels",
        ("parts/dilate.cl:dilate_border",),
        partial(_dilate, listed=True),
    ),
    Case(
        "Prefix sums by waves",
        ("parts/scan.cl:scan_waves", "parts/scan.cl:scan_add"),
        _waves,
        (7, 24, 64, 100),
    ),
    *(
        Case(
            f"Prefix sums by blocks ({layout})",
            tuple(
                f"parts/scan.cl:{name}" for name in ("scan_block_sums", "scan_sums", "scan_blocks")
            ),
            partial(_blocks, layout=layout),
        )
        for layout in LAYOUTS
    ),
]
