"""Launches of two and three dimensions: places of work-items, and lines of tiles."""

from __future__ import annotations

import numpy as np
import pyopencl as cl
import pytest

from gibench.device import list_devices
from gibench.trace.analysis import analyse
from gibench.trace.request import Sampling, TracedArgument, TraceRequest
from gibench.trace.trace import trace_launch

pytest.importorskip("llvmlite")
WHOLE = Sampling(runs=1, length=1 << 20, whole=True)
PLACES = """
__kernel void places(__global uint *to, __local uint *room)
{
    const size_t group = get_local_size(0) * get_local_size(1) * get_local_size(2);
    const size_t item = (get_local_id(2) * get_local_size(1) + get_local_id(1)) * get_local_size(0)
                        + get_local_id(0);
    const size_t number = (get_group_id(2) * get_num_groups(1) + get_group_id(1))
                          * get_num_groups(0) + get_group_id(0);
    const size_t row = get_global_id(2) * get_global_size(1) + get_global_id(1);
    const uint place = row * get_global_size(0) + get_global_id(0);
    WAIT
    to[number * group + FROM] = place * 8 + get_work_dim();
}
"""
STRAIGHT = PLACES.replace("WAIT", "").replace("FROM", "item")
WAITING = (
    PLACES.replace("WAIT", "room[item] = place; barrier(CLK_LOCAL_MEM_FENCE);")
    .replace("place * 8", "room[group - 1 - item] * 8")
    .replace("FROM", "item")
)
TILES = """
__kernel void tiles(__global const float *from, __global float *to, int pitch)
{
    const size_t at = get_global_id(1) * pitch + get_global_id(0);
    to[at] = from[at];
}
"""


def ran(source: str, items: tuple[int, ...], group: tuple[int, ...]) -> np.ndarray:
    device = list_devices()[0]
    context = cl.Context([device])
    queue = cl.CommandQueue(context)
    out = np.zeros(np.prod(items), np.uint32)
    buffer = cl.Buffer(context, cl.mem_flags.READ_WRITE, out.nbytes)
    kernel = cl.Kernel(cl.Program(context, source).build(), "places")
    kernel(queue, items, group, buffer, cl.LocalMemory(4 * int(np.prod(group))))
    cl.enqueue_copy(queue, out, buffer)
    return out


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("source", [STRAIGHT, WAITING], ids=["straight", "waiting"])
def test_work_items_are_where_the_device_has_them(
    source: str, dimensions: int, rng: np.random.Generator
) -> None:
    group = tuple(rng.integers(1, 5, dimensions).tolist())
    groups = tuple(rng.integers(1, 4, dimensions).tolist())
    items = tuple(a * b for a, b in zip(group, groups, strict=True))
    count = int(np.prod(group))
    args = [
        TracedArgument("to", np.zeros(np.prod(items), np.uint32), 0, True),
        TracedArgument("room", None, 4 * count),
    ]
    request = TraceRequest(source, {}, "places", args, count, groups, "places", group)
    assert (trace_launch(request, WHOLE).outputs["to"] == ran(source, items, group)).all()


@pytest.mark.parametrize(("group", "lines"), [((16, 16), 1.0), ((8, 8), 2.0), ((32, 2), 1.0)])
def test_lines_of_tiles_are_those_of_their_rows(group: tuple[int, int], lines: float) -> None:
    side = 64
    args = [
        TracedArgument("from", np.zeros(side * side, np.float32)),
        TracedArgument("to", np.zeros(side * side, np.float32), 0, True),
        TracedArgument("pitch", np.int32(side)),
    ]
    groups = (side // group[0], side // group[1])
    request = TraceRequest(TILES, {}, "tiles", args, group[0] * group[1], groups, "tiles", group)
    found = analyse(trace_launch(request, WHOLE), [32])
    assert found.simd[0].lines_over_fewest == pytest.approx(lines)
