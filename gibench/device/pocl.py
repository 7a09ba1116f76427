"""PoCL on a processor that its LLVM does not know.

PoCL 3.0, which ``pip`` brings, holds LLVM 14. That calls a processor that is newer than itself
(any Zen 5) ``generic``, a name that its own clang then refuses: no kernel can be built (PoCL issue
1049). Here the device is told the name of the nearest processor that LLVM 14 knows, before
anything is built. Nothing on disk changes; where PoCL knows the processor, nothing at all.
"""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path
from typing import Any

_UNKNOWN = b"generic\0"
_DEVICE_BYTES = 4096
"""More than PoCL's ``struct _cl_device_id`` (pocl_cl.h) takes; its ``llvm_cpu`` lies within."""


def name_processor(cl_device: Any) -> str | None:
    """Give PoCL's compiler a processor's name that it knows, where it has none.

    Args:
        cl_device: any device; of other platforms than PoCL it is left alone.

    Returns:
        The name given, None where there was nothing to mend.
    """
    if not sys.platform.startswith("linux") or "Portable" not in cl_device.platform.name:
        return None
    regions = _readable_regions()
    size = min(_DEVICE_BYTES, _bytes_there(regions, cl_device.int_ptr))
    words = (ctypes.c_uint64 * (size // 8)).from_address(cl_device.int_ptr)
    for pointer in words:
        if _bytes_there(regions, pointer) < len(_UNKNOWN):
            continue
        if ctypes.string_at(pointer, len(_UNKNOWN)) == _UNKNOWN:
            name = nearest_known(*_processor())
            ctypes.memmove(pointer, name.encode() + b"\0", len(name) + 1)
            return name
    return None


def nearest_known(vendor: str, flags: frozenset[str]) -> str:
    """A processor of LLVM 14 that has no instruction that this one lacks; at most 7 letters.

    Args:
        vendor: ``AuthenticAMD``, ``GenuineIntel`` or another.
        flags: as in ``/proc/cpuinfo``.
    """
    if not {"avx2", "fma", "bmi1", "bmi2", "f16c", "movbe"} <= flags:
        return "x86-64"
    amd = {"adx", "clwb", "sha_ni", "vaes", "vpclmulqdq", "sse4a"}
    return "znver3" if vendor == "AuthenticAMD" and amd <= flags else "haswell"


def _processor() -> tuple[str, frozenset[str]]:
    fields = {}
    for line in Path("/proc/cpuinfo").read_text().split("\n\n")[0].splitlines():
        key, _, value = line.partition(":")
        fields[key.strip()] = value.strip()
    return fields.get("vendor_id", ""), frozenset(fields.get("flags", "").split())


def _readable_regions() -> list[tuple[int, int]]:
    regions = []
    for line in Path("/proc/self/maps").read_text().splitlines():
        addresses, rights = line.split()[:2]
        if rights[0] == "r":
            first, last = (int(number, 16) for number in addresses.split("-"))
            regions.append((first, last))
    return regions


def _bytes_there(regions: list[tuple[int, int]], address: int) -> int:
    """How many bytes can be read from ``address`` on."""
    return next((last - address for first, last in regions if first <= address < last), 0)
