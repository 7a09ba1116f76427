"""The device prefix sums against NumPy's, exact, for every length and work-group size."""

from dataclasses import replace

import numpy as np
import pytest

from gibench.device import SIMT, WIDE, Device
from gibench.profiles import load_profile
from gibench.techniques.parts.scan import BlockScan, WaveScan

LENGTHS = (1, 2, 31, 32, 33, 255, 256, 257, 4096, 4097, 65_537)
A_MILLION = 1_000_003  # by groups of 256 alone, where it takes no longer than the others


def run(device, launches, workgroup_size):
    for launch in launches:
        device.enqueue(launch, workgroup_size)


def waves(device, values, size):
    scan = WaveScan.create(device, "scan", len(values), size)
    source = device.upload("values", values)
    prefix = device.empty("prefix", len(values), np.uint32)
    run(device, scan.launches(source, prefix), size)
    return device.read(prefix)


def blocks(device, values, size, capacity=None):
    capacity = capacity or len(values)
    scan = BlockScan.create(device, "scan", capacity, size)
    room = np.full(capacity, 0xFFFFFFFF, np.uint32)  # what lies past the end must not count
    room[: len(values)] = values
    source = device.upload("values", room)
    length = device.upload("length", np.array([len(values)], np.uint32))
    prefix = device.empty("prefix", capacity + 1, np.uint32)
    run(device, scan.launches(source, length, prefix, lambda: len(values)), size)
    return device.read(prefix)[: len(values) + 1]


def expected(values):
    sums = np.zeros(len(values) + 1, np.uint64)
    np.cumsum(values, out=sums[1:])
    return (sums & 0xFFFFFFFF).astype(np.uint32)


def some_values(rng, length):
    return rng.integers(0, 4000, length, dtype=np.uint32)


def device_of(simd_width, layout=None):
    profile = replace(load_profile("iphone7"), simd_width=simd_width, max_workgroup_size=4096)
    return Device(profile, layout=layout)


def with_lengths(shapes, more):
    """Each shape, its work-group size first, with every length; few with a million. ``more`` shapes
    are slow: three kernels are compiled for each.
    """
    few = [(length, *shape) for shape in shapes for length in LENGTHS]
    few += [(A_MILLION, *shape) for shape in shapes if shape[0] == 256]
    every = [(length, *s) for s in (*shapes, *more) for length in (*LENGTHS, A_MILLION)]
    return [pytest.param(*one, marks=() if one in few else pytest.mark.slow) for one in every]


@pytest.mark.parametrize(
    ("length", "size", "simd"),
    with_lengths([(96, 32), (256, 64), (7, 1)], [(32, 32), (24, 1), (512, 32)]),
)
def test_waves_scan_exactly(rng, length, simd, size):
    values = some_values(rng, length)
    np.testing.assert_array_equal(waves(device_of(simd), values, size), expected(values)[:-1])


@pytest.mark.parametrize(
    ("length", "size", "layout"),
    with_lengths(
        # Of SIMT 8, 4 and 1 values of a work-item in local memory at once.
        [*((size, WIDE) for size in (3, 96, 256)), *((size, SIMT) for size in (7, 300, 1024))],
        [*((size, WIDE) for size in (1, 32, 1024)), *((size, SIMT) for size in (1, 96, 256))],
    ),
)
def test_blocks_scan_exactly(rng, length, size, layout):
    values = some_values(rng, length)
    np.testing.assert_array_equal(blocks(device_of(1, layout), values, size), expected(values))


@pytest.mark.parametrize("layout", [WIDE, SIMT])
def test_blocks_scan_fewer_than_there_is_room_for(rng, layout):
    values = some_values(rng, 5000)
    found = blocks(device_of(1, layout), values, 64, capacity=9001)
    np.testing.assert_array_equal(found, expected(values))


def test_sums_wrap_at_32_bits():
    values = np.full(70_001, 0x0FFFFFFF, np.uint32)
    np.testing.assert_array_equal(blocks(device_of(1), values, 32), expected(values))


@pytest.mark.slow
@pytest.mark.parametrize("scan", [waves, blocks])
def test_ten_million_values(rng, scan):
    values = some_values(rng, 10_000_000)
    got = scan(device_of(64), values, 256)
    np.testing.assert_array_equal(got, expected(values)[: len(got)])
