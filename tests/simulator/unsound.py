"""Kernels with one fault each, to see that Oclgrind's log tells. Usage: python unsound.py FAULT"""

from __future__ import annotations

import sys

import numpy as np
import pyopencl as cl

SOURCES = {
    "bounds": "kernel void fault(global float *a) { a[get_global_id(0) + 60] = 1.0f; }",
    "race": "kernel void fault(global float *a) { a[0] = (float)get_global_id(0); }",
    "uninitialised": (
        "kernel void fault(global float *a) { local float b[64]; "
        "a[get_global_id(0)] = b[get_local_id(0)] > 1.0f ? 2.0f : 3.0f; }"
    ),
    "none": "kernel void fault(global float *a) { a[get_global_id(0)] = 1.0f; }",
}

if __name__ == "__main__":
    device = cl.get_platforms()[0].get_devices()[0]
    context = cl.Context([device])
    queue = cl.CommandQueue(context)
    kernel = cl.Kernel(cl.Program(context, SOURCES[sys.argv[1]]).build(), "fault")
    data = cl.Buffer(context, cl.mem_flags.READ_WRITE, 256)
    cl.enqueue_fill_buffer(queue, data, np.uint8(0), 0, 256)
    kernel.set_args(data)
    cl.enqueue_nd_range_kernel(queue, kernel, (32,), (16,))
    queue.finish()
