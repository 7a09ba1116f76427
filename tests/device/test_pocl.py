"""PoCL builds kernels on processors that its LLVM does not know."""

from __future__ import annotations

import subprocess
import sys

import pytest

from gibench.device.pocl import nearest_known

ZEN5 = frozenset(
    [
        "avx2",
        "fma",
        "bmi1",
        "bmi2",
        "f16c",
        "movbe",
        "adx",
        "clwb",
        "sha_ni",
        "vaes",
        "vpclmulqdq",
        "sse4a",
    ]
)

# PoCL reads the processor's name once, when its platform is first asked for: a process of its own.
UNKNOWN = """
import ctypes, pyopencl as cl
from gibench.device import pocl
(device,) = [d for p in cl.get_platforms() if "Portable" in p.name for d in p.get_devices()]
regions = pocl._readable_regions()
words = (ctypes.c_uint64 * 512).from_address(device.int_ptr)
text = [ctypes.string_at(w, 24).split(b"\\0")[0] if pocl._bytes_there(regions, w) >= 24 else b""
        for w in words]
# The processor's name lies behind that of its kind (x86_64-unknown-linux-gnu), whatever it is.
place = next(words[i + 1] for i, w in enumerate(text) if w.startswith(b"x86_64") and text[i + 1])
ctypes.memmove(place, b"generic\\0", 8)
print(pocl.name_processor(device), pocl.name_processor(device))
source = "__kernel void twice(__global float *x) { x[get_global_id(0)] *= 2 + 0 * %d; }" % id(words)
cl.Program(cl.Context([device]), source).build()
"""


def test_a_processor_that_llvm_calls_generic_gets_a_name_that_clang_takes():
    ran = subprocess.run(
        [sys.executable, "-c", UNKNOWN], capture_output=True, text=True, timeout=120
    )
    assert ran.returncode == 0, ran.stderr
    first, second = ran.stdout.split()
    assert first in ("znver3", "haswell", "x86-64")
    assert second == "None"  # named once, it is left alone


@pytest.mark.parametrize(
    ("vendor", "flags", "name"),
    [
        ("AuthenticAMD", ZEN5, "znver3"),
        ("AuthenticAMD", ZEN5 - {"vaes"}, "haswell"),
        ("GenuineIntel", ZEN5, "haswell"),
        ("GenuineIntel", ZEN5 - {"avx2"}, "x86-64"),
        ("", frozenset(), "x86-64"),
    ],
)
def test_the_nearest_processor_has_no_instruction_too_many(vendor, flags, name):
    assert nearest_known(vendor, flags) == name
