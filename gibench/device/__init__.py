"""The opened device: programs, budgeted buffers, launches, event clock."""

from gibench.device.buffers import Buffer, MemoryLedger, SharedBuffer
from gibench.device.build import LAYOUTS, SIMT, WIDE, Define, Layout, build_program, vector_width
from gibench.device.counting import RayCounts, count_rays
from gibench.device.device import Device
from gibench.device.launch import (
    Access,
    Argument,
    Launch,
    LocalMemory,
    PreparedLaunch,
    Scalar,
    Value,
    integer,
    local,
    reads,
    scalar,
    unsigned,
    updates,
    writes,
)
from gibench.device.layout import BufferSpec, largest, total_bytes
from gibench.device.program import Instrument, Parameter, Program, ProgramSpec
from gibench.device.selection import list_devices
from gibench.device.source import kernel_source

__all__ = [
    "LAYOUTS",
    "SIMT",
    "WIDE",
    "Access",
    "Argument",
    "Buffer",
    "BufferSpec",
    "Define",
    "Device",
    "Instrument",
    "Launch",
    "Layout",
    "LocalMemory",
    "MemoryLedger",
    "Parameter",
    "PreparedLaunch",
    "Program",
    "ProgramSpec",
    "RayCounts",
    "Scalar",
    "SharedBuffer",
    "Value",
    "build_program",
    "count_rays",
    "integer",
    "kernel_source",
    "largest",
    "list_devices",
    "local",
    "reads",
    "scalar",
    "total_bytes",
    "unsigned",
    "updates",
    "vector_width",
    "writes",
]
