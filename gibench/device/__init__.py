"""The opened device: programs, budgeted buffers, event clock."""

from gibench.device.buffers import Buffer, MemoryLedger
from gibench.device.build import build_program, vector_width
from gibench.device.device import Device, Program, list_devices
from gibench.device.source import kernel_source

__all__ = [
    "Buffer",
    "Device",
    "MemoryLedger",
    "Program",
    "build_program",
    "kernel_source",
    "list_devices",
    "vector_width",
]
