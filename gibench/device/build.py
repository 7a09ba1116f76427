"""Building OpenCL programs, and how wide the vectors are that they are compiled for."""

from __future__ import annotations

import platform
import re
import warnings
from collections.abc import Mapping
from functools import cache
from typing import Any, Final, Literal

import pyopencl as cl

from gibench.device.pocl_cache import check_cache

Define = int | float | str | bool

Layout = Literal["wide", "simt"]
"""How kernels of the variant ``tuned`` are shaped (see the constants)."""
WIDE: Final = "wide"
"""Explicit vectors, a stream of memory per work-item: what a CPU's compiler of one work-item at a
time wants."""
SIMT: Final = "simt"
"""Scalars, neighbouring work-items on neighbouring addresses: what runs in lockstep, on a GPU or
where a CPU's compiler makes vectors of work-items."""
LAYOUTS: Final[tuple[Layout, ...]] = (WIDE, SIMT)
LEAST_WIDE: Final = 4
"""Floats per vector from which a device is taken to prefer explicit ones."""
_MOST_WIDE = 16

# No warnings (OpenCL 1.2, section 5.6.4.4): clang counts every 16-wide argument of an inlined
# function as a change of the binary interface where the processor has no such registers.
_OPTIONS = ("-w", "-cl-kernel-arg-info")

_DECLARE: Final = "DECLARE_BUILTINS"
WITHOUT_HEADER: Final = ("-D_OPENCL_H_=1", f"-D{_DECLARE}=1")
"""Options with which PoCL 3 skips clang's header of all builtins, by the header's own guard, and
``kernels_cl/common/declared.cl`` declares those that kernels call: a tenth of a second less for
each program."""

# PoCL 3.0 prefers vectors of 16 on every x86 processor with AVX-512, yet its LLVM 14 compiles for
# Zen 4 and later as for Zen 3, without it. There a program that calls a builtin on 16 floats is
# written to PoCL's cache as bitcode that cannot be read again. The compiler's own macro tells.
_TARGET = f"""
// Calls no builtin, so that {_DECLARE} has none to declare.
#if defined(__x86_64__) && !defined(__AVX512F__)
__kernel void eight_lanes(void) {{}}
#else
__kernel void sixteen_lanes(void) {{}}
#endif
"""


def build_program(context: Any, source: str, defines: Mapping[str, Define]) -> Any:
    """Compile ``source`` in ``context`` with those of ``defines`` as macros that it names.

    Raises:
        pyopencl.RuntimeError: the compiler refuses it.
        CannotRun: the compiler's cache is unusable.
    """
    for cl_device in context.devices:
        check_cache(cl_device)
    options = [*_OPTIONS, *macro_options(named(source, defines))]
    with warnings.catch_warnings():
        # Some drivers' compilers (Intel's) tell of every build that it went well.
        warnings.simplefilter("ignore", cl.CompilerWarning)
        if _DECLARE in source and all(map(_has_header, context.devices)):
            try:
                return cl.Program(context, source).build(options=[*WITHOUT_HEADER, *options])
            except cl.RuntimeError:
                pass  # a builtin that is not declared, or a fault that the next build tells
        return cl.Program(context, source).build(options=options)


def _has_header(cl_device: Any) -> bool:
    """Whether a device's compiler reads clang's header of all builtins unless its guard is set, and
    can do without: on other processors builtins.cl is empty, and its builtins are the header's.
    """
    return " PoCL 3." in cl_device.platform.version and platform.machine() == "x86_64"


def named(source: str, defines: Mapping[str, Define]) -> dict[str, Define]:
    """Those of ``defines`` that ``source`` names outside comments: others change nothing that is
    compiled, but drivers' caches would take it for another program.
    """
    words = set(re.findall(r"\w+", re.sub(r"//[^\n]*", "", source)))
    return {name: value for name, value in defines.items() if name in words}


def macro_options(defines: Mapping[str, Define]) -> tuple[str, ...]:
    """``defines`` as the compiler's options."""
    return tuple(f"-D{name}={_macro(value)}" for name, value in sorted(defines.items()))


@cache
def vector_width(cl_device: Any) -> int:
    """Floats per vector that suit a device: 16 with AVX-512, 8 with AVX, 1 on most GPUs."""
    preferred = int(cl_device.preferred_vector_width_float)
    if preferred <= 8:
        return preferred
    names = build_program(cl.Context([cl_device]), _TARGET, {}).kernel_names
    return 8 if "eight_lanes" in names else 16


def preferred_layout(cl_device: Any) -> Layout:
    """What suits a device: ``wide`` where it prefers explicit vectors of 4 floats and more, or has
    registers that hold them (Intel's runtime for CPUs, which would rather vectorise over
    work-items, runs ``wide`` faster all the same: docs/layouts.md).
    """
    native = int(cl_device.native_vector_width_float)
    return WIDE if max(vector_width(cl_device), native) >= LEAST_WIDE else SIMT


def width_of(cl_device: Any, layout: Layout) -> int:
    """Floats per vector of a layout on a device: 1 in ``simt``; in ``wide`` those that it prefers,
    or, if it would rather have scalars, those that its registers hold.
    """
    if layout == SIMT:
        return 1
    preferred = vector_width(cl_device)
    if preferred >= LEAST_WIDE:
        return preferred
    native = int(cl_device.native_vector_width_float)
    return min(max(native, LEAST_WIDE), _MOST_WIDE)


def lanes_together(cl_device: Any) -> int:
    """Work-items that a device computes in whole vectors only, those left over one by one: on a CPU
    that would rather vectorise over work-items (Intel's runtime) as many floats as its registers
    hold; elsewhere 1.
    """
    scalar = int(cl_device.preferred_vector_width_float) < LEAST_WIDE
    if not scalar or not cl_device.type & cl.device_type.CPU:
        return 1
    return min(max(int(cl_device.native_vector_width_float), 1), _MOST_WIDE)


def unsigned_literal(value: int) -> str:
    """A macro's value of type uint."""
    return f"{value:#x}u"


def _macro(value: Define) -> str:
    if isinstance(value, bool):
        return "1" if value else "0"
    if isinstance(value, float):
        return f"{value!r}f"
    return str(value)
