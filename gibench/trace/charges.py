"""What an instruction costs a GPU's lane, whatever software stands behind it on this CPU.

Costs are issue slots of one lane. A builtin function is charged as a GPU has it, in its special
function unit or in a few instructions, and not by the software that PoCL calls instead.
"""

from __future__ import annotations

import re
from typing import NamedTuple


class Charge(NamedTuple):
    """What one call does for each component.

    Attributes:
        flops: floating-point operations.
        instructions: issue slots.
    """

    flops: float
    instructions: float


_SIMPLE = Charge(1, 1)
_BITS = Charge(0, 1)
_ROOT = Charge(1, 8)
_NATIVE = Charge(1, 8)
_EXPONENTIAL = Charge(1, 10)
_CIRCULAR = Charge(1, 20)
_INVERSE = Charge(1, 30)
_OTHER = Charge(1, 4)

# Special functions: 16 results a clock of a unit that adds 128 (NVIDIA, CUDA C++ Programming Guide,
# "Arithmetic Instructions", compute capability 6.1): 8 issue slots. The others are estimates: an
# exponential scales its argument, sin and cos reduce it, inverse functions are polynomials.
_CHARGES: dict[str, Charge] = {
    **dict.fromkeys(("sqrt", "rsqrt", "half_sqrt", "half_rsqrt"), _ROOT),
    **dict.fromkeys(("native_sqrt", "native_rsqrt", "native_recip", "half_recip"), _NATIVE),
    **dict.fromkeys(("native_sin", "native_cos", "native_exp", "native_log"), _NATIVE),
    **dict.fromkeys(("native_exp2", "native_log2", "native_powr", "native_divide"), _NATIVE),
    **dict.fromkeys(
        ("exp", "exp2", "exp10", "log", "log2", "log10", "log1p", "expm1"), _EXPONENTIAL
    ),
    **dict.fromkeys(("pow", "powr", "pown", "rootn", "cbrt", "hypot"), Charge(1, 20)),
    **dict.fromkeys(("sin", "cos", "tan", "sinpi", "cospi", "tanpi"), _CIRCULAR),
    "sincos": Charge(2, 30),
    **dict.fromkeys(("asin", "acos", "atan", "atan2", "asinpi", "acospi", "atanpi"), _INVERSE),
    **dict.fromkeys(("sinh", "cosh", "tanh", "asinh", "acosh", "atanh"), _INVERSE),
    **dict.fromkeys(("fma", "mad", "fmuladd", "dot"), Charge(2, 1)),
    **dict.fromkeys(("mix",), Charge(3, 2)),
    **dict.fromkeys(("length", "distance", "fast_length"), Charge(2, 4)),
    **dict.fromkeys(("normalize", "fast_normalize"), Charge(3, 5)),
    "cross": Charge(3, 2),
    **dict.fromkeys(("fmin", "fmax", "min", "max", "minnum", "maxnum", "minimum"), _SIMPLE),
    **dict.fromkeys(("maximum", "floor", "ceil", "trunc", "rint", "round", "roundeven"), _SIMPLE),
    **dict.fromkeys(("clamp", "step", "sign", "fract"), Charge(1, 2)),
    "smoothstep": Charge(5, 6),
    **dict.fromkeys(("fabs", "copysign", "abs", "smin", "smax", "umin", "umax", "select"), _BITS),
    **dict.fromkeys(("ctlz", "cttz", "ctpop", "clz", "popcount", "bitreverse", "bswap"), _BITS),
    **dict.fromkeys(("fshl", "fshr", "rotate", "isnan", "isinf", "isfinite", "any", "all"), _BITS),
    **dict.fromkeys(("mul_hi", "mad_hi", "mul24", "mad24", "hadd", "rhadd", "bitselect"), _BITS),
    **dict.fromkeys(("fptosi.sat", "fptoui.sat", "usub.sat", "uadd.sat", "is.fpclass"), _BITS),
}
DIVISION = Charge(1, 8)
"""A reciprocal of the special function unit; refinement left out."""
INTEGER_DIVISION = Charge(0, 20)
"""No GPU has the instruction; an estimate of what stands for it."""

_WORK_ITEM = re.compile(r"get_(global|local|group|num|work|enqueued)|barrier|mem_fence|printf")


def builtin_name(function: str) -> str | None:
    """The OpenCL builtin that a function of the bitcode is, None where it is the kernel's own.

    >>> builtin_name("_Z9_cl_atan2ff")
    'atan2'
    """
    match = re.match(r"_Z(\d+)", function)
    if match is None:
        return None
    start = match.end()
    return function[start : start + int(match[1])].removeprefix("_cl_")


def is_charged(function: str, has_pointer: bool) -> bool:
    """Whether a function of the bitcode is charged by the table rather than looked into.

    Args:
        function: its name.
        has_pointer: whether a parameter of it is a pointer.
    """
    name = builtin_name(function)
    if name is None or _WORK_ITEM.match(name):
        return False
    return name in _CHARGES or not has_pointer


def charge_of(function: str) -> Charge | None:
    """What a call of ``function`` costs for each component; None of what costs nothing."""
    if function.startswith("llvm.x86."):
        return _BITS if "cvt" in function or "blend" in function else _SIMPLE
    if function.startswith("llvm."):
        name = function.removeprefix("llvm.")
        known = [key for key in _CHARGES if name == key or name.startswith(key + ".")]
        return _CHARGES[max(known, key=len)] if known else None
    name_or_none = builtin_name(function)
    if name_or_none is None:
        return None
    if name_or_none.startswith(("convert_", "as_")):
        return _BITS
    return _CHARGES.get(name_or_none, _OTHER)
