"""Measuring what the executing machine does at most: the roofs every pass is held against."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from gibench.device import Device, Launch, ProgramSpec, reads, scalar, unsigned, writes
from gibench.errors import CannotRun
from gibench.measure.statistics.summary import NAN, Roofs
from gibench.profiles import DeviceProfile

_STREAM_BYTES = 64 << 20  # per buffer: past the last-level cache share of a core
_ITEMS_PER_UNIT = 64  # work-items per compute unit and launch: enough to balance
_GROUP = 8  # work-items: small, so that all cores are busy
_FMA_CHAINS = 10  # as in roofs.cl
_FMA_TURNS = 20_000
_LAUNCHES = 100
_REPEATS = 7
_RAYS = 1 << 17


def measure_roofs(profile: DeviceProfile, cl_device: Any = None) -> Roofs:
    """Measure the roofs of ``cl_device`` in about a second.

    They are the machine's own: of the profile they take the work-group size of rays alone.

    Raises:
        CannotRun: the device cannot allocate the stream buffers.
    """
    device = Device.unlimited(cl_device)
    read, triad = _streams(device)
    return Roofs(
        read,
        triad,
        _fma(device),
        _launch_us(device),
        _mrays(device, profile.default_workgroup_size),
    )


def _streams(device: Device) -> tuple[float, float]:
    """Bandwidth of the streaming read and of the triad, GB/s (the best of several)."""
    width = device.vector_width
    program = ProgramSpec("measure/roofs.cl", {"VEC": width})
    count = _STREAM_BYTES // (4 * width)
    items = int(device.cl_device.max_compute_units) * _ITEMS_PER_UNIT
    stretch = -(-count // items)
    stretch += -stretch % 4
    rng = np.random.default_rng(0)
    a = device.empty("roof_a", count * width, np.float32)
    b = device.upload("roof_b", rng.random(count * width, np.float32))
    c = device.upload("roof_c", rng.random(count * width, np.float32))
    lengths = (unsigned("count", count), unsigned("stretch", stretch))
    sums = (writes("sums", a), reads("b", b))
    added = (writes("a", a), reads("b", b), reads("c", c), scalar("scalar", np.float32(0.5)))
    read = Launch(program, "roof_read", (*sums, *lengths), items, workgroup_size=_GROUP)
    triad = Launch(program, "roof_triad", (*added, *lengths), items, workgroup_size=_GROUP)
    rates = (
        b.nbytes / _best_seconds(device, read) * 1e-9,
        3 * b.nbytes / _best_seconds(device, triad) * 1e-9,
    )
    device.release(a, b, c)
    return rates


def _fma(device: Device) -> float:
    """Multiply-add rate, GFLOP/s; a multiply-add counts two."""
    width = device.vector_width
    program = ProgramSpec("measure/roofs.cl", {"VEC": width})
    items = int(device.cl_device.max_compute_units) * _ITEMS_PER_UNIT
    out = device.empty("roof_fma", items * width, np.float32)
    args = (
        writes("out", out),
        scalar("factor", np.float32(0.5)),
        unsigned("turns", _FMA_TURNS),
        unsigned("count", items),
    )
    launch = Launch(program, "roof_fma", args, items, workgroup_size=_GROUP)
    flops = 2.0 * _FMA_CHAINS * width * _FMA_TURNS * items
    rate = flops / _best_seconds(device, launch) * 1e-9
    device.release(out)
    return rate


def _launch_us(device: Device) -> float:
    """Wall time of one of many empty launches in a row, microseconds."""
    out = device.empty("roof_launch", 1, np.float32)
    program = ProgramSpec("measure/roofs.cl", {"VEC": device.vector_width})
    args = (writes("out", out),)
    launch = device.prepare(Launch(program, "roof_launch", args, 1, workgroup_size=1), 1)
    best = np.inf
    for _ in range(_REPEATS):
        device.queue.finish()
        begin = time.perf_counter()
        for _ in range(_LAUNCHES):
            launch.enqueue(device.queue)
        device.queue.finish()
        best = min(best, (time.perf_counter() - begin) / _LAUNCHES)
    device.release(out)
    return best * 1e6


def _mrays(device: Device, workgroup_size: int) -> float:
    """Closest-hit rate of incoherent rays inside a closed box with two boxes in it, Mrays/s."""
    from gibench.rays.bvh import build_bvh
    from gibench.rays.device_bvh import DeviceBvh, DeviceTracer

    boxes = [
        _box((0, 0, 0), (1, 1, 1)),
        _box((0.2, 0, 0.2), (0.45, 0.6, 0.45)),
        _box((0.6, 0, 0.55), (0.85, 0.3, 0.8)),
    ]
    rng = np.random.default_rng(0)
    origins = rng.uniform(0.02, 0.98, (_RAYS, 3)).astype(np.float32)
    directions = rng.normal(size=(_RAYS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    tree = DeviceBvh.upload(device, build_bvh(np.concatenate(boxes)), "roof_bvh")
    try:
        tracer = DeviceTracer(device, tree, workgroup_size, _RAYS, "roof_rays")
    except CannotRun:
        return NAN
    seconds = np.inf
    for _ in range(_REPEATS):
        tracer.closest(origins, directions.astype(np.float32))
        seconds = min(seconds, tracer.kernel_seconds)
    tracer.release()
    return _RAYS / seconds * 1e-6


def _box(low: tuple[float, ...], high: tuple[float, ...]) -> np.ndarray[Any, np.dtype[np.float32]]:
    """(12, 3, 3) corners of the twelve triangles of a box; winding does not matter to rays."""
    lo, hi = np.array(low), np.array(high)
    triangles = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (lo, hi):
            quad = np.array([side] * 4, dtype=np.float32)
            quad[:, u] = [lo[u], hi[u], hi[u], lo[u]]
            quad[:, v] = [lo[v], lo[v], hi[v], hi[v]]
            triangles += [quad[[0, 1, 2]], quad[[0, 2, 3]]]
    return np.stack(triangles).astype(np.float32)


def _best_seconds(device: Device, launch: Launch) -> float:
    """The shortest of several times that ``launch`` takes, by the device's clock."""
    prepared = device.prepare(launch, _GROUP)
    best = np.inf
    for _ in range(_REPEATS + 1):  # the first also builds and touches pages; the best ignores it
        event = prepared.enqueue(device.queue)
        event.wait()
        best = min(best, (event.profile.end - event.profile.start) * 1e-9)
    return best
