"""Programs without the compiler's header of all builtins (kernels_cl/common/declared.cl)."""

from __future__ import annotations

import platform
import re
from typing import Any

import numpy as np
import pyopencl as cl
import pytest
from scipy.special import erf
from support.shared_builds import ALLOWED

from gibench.device import build_program, list_devices
from gibench.device.build import WITHOUT_HEADER
from gibench.device.source import kernel_source
from gibench.trace.bitcode import _packed

FLOATS = ("float", "float2", "float3", "float4", "float8", "float16")
OF_ONE = ("acos", "asin", "atan", "cos", "exp", "exp2", "log", "log2")
OF_ONE += ("rint", "round", "sign", "sin", "tan", "trunc")
OF_TWO = ("atan2", "pow", "powr", "step")
ATOMICS = ("add(%s, 2)", "max(%s, 2)", "min(%s, 2)", "inc(%s)", "dec(%s)")
WORK_ITEM = ("global_id", "global_size", "group_id", "local_id", "local_size", "num_groups")
USES = """
__kernel void uses(__global float *f, __global int *i, __global uint *u, __global half *h,
                   __local half *lh)
{
    __local int li[1];
    __local uint lu[1];
    %s
}
"""
NOT_DECLARED = f"{ALLOWED}\n__kernel void f(__global float *x) {{ x[0] = erf(x[0]); }}"


@pytest.fixture
def pocl() -> Any:
    """A context of PoCL 3 on x86."""
    found = list_devices()[0]
    if " PoCL 3." not in found.platform.version or platform.machine() != "x86_64":
        pytest.skip("of PoCL 3 on x86 alone")
    return cl.Context([found])


def every_declared() -> list[str]:
    """Statements that call each declared builtin with each type."""
    lines = [f"u[get_{name}(1)] += get_{name}(0);" for name in WORK_ITEM]
    lines += ["li[0] = i[0]; lu[0] = u[0];", "barrier(CLK_LOCAL_MEM_FENCE);"]
    for kind in FLOATS:
        lines += [f"{{ __global {kind} *p = (__global {kind} *)f;"]
        lines += [f"p[1] = {name}(p[0]);" for name in OF_ONE]
        lines += [f"p[1] = {name}(p[0], p[1]);" for name in OF_TWO]
        lines += ["p[1] = fma(p[0], p[1], p[2]); p[1] = step(f[0], p[1]); }"]
        lines += [f"i[1] += all(*(__global {kind.replace('float', 'int')} *)i);"]
    lines += ["u[1] += convert_uint_sat_rte(f[0]);"]
    lines += ["*(__global int3 *)i = convert_int3_rtz(*(__global float3 *)f);"]
    lines += [f"atomic_{each % at};" for each in ATOMICS for at in ("i", "u", "li", "lu")]
    return lines + [
        f"vstore_half{width}(vload_half{width}(1, {at}), 2, {at});"
        for at in ("h", "lh")
        for width in ("", "2", "3", "4")
    ]


def code(program: Any) -> str:
    """What a program was compiled to, without the names that PoCL gives anew in each build."""
    from llvmlite import binding

    packed = _packed(program.get_info(cl.program_info.BINARIES)[0])
    assert packed is not None
    told = re.sub("source_filename.*", "", str(binding.parse_bitcode(packed)), count=1)
    return re.sub(r"(%struct\.\w+)(\.\d+)+", r"\1", told)


def test_what_is_declared_compiles_to_what_the_header_s_does(pocl: Any) -> None:
    # As they are, before inlined ones stand in for some.
    source = kernel_source("common/declared.cl").split('#line 1 "common/builtins.cl"')[0]
    uses = "\n".join(every_declared())
    declared = set(re.findall(r"(\w+)\([^()]*\);", source))
    assert {name for name in declared if not re.search(rf"\b{name}\(", uses)} == set()
    with_header, without = (
        cl.Program(pocl, source + USES % uses).build(options=["-w", *more])
        for more in ((), WITHOUT_HEADER)
    )
    assert code(with_header) == code(without)


def test_kernels_are_built_without_the_header(pocl: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[list[str]] = []
    build = cl.Program.build

    def recorded(self: Any, options: list[str]) -> Any:
        asked.append(options)
        return build(self, options)

    monkeypatch.setattr(cl.Program, "build", recorded)
    build_program(pocl, kernel_source("common/random.cl"), {})
    assert [tuple(options[:2]) for options in asked] == [WITHOUT_HEADER]
    build_program(pocl, "__kernel void of_ones_own(void) {}", {})
    assert WITHOUT_HEADER[0] not in asked[1]


def test_a_builtin_that_is_not_declared_is_there_all_the_same(pocl: Any) -> None:
    built = build_program(pocl, kernel_source("common/vec.cl") + NOT_DECLARED, {})
    queue, x = cl.CommandQueue(pocl), np.array([0.3], np.float32)
    held = cl.Buffer(pocl, cl.mem_flags.COPY_HOST_PTR, hostbuf=x)
    built.f(queue, (1,), None, held)
    cl.enqueue_copy(queue, x, held)
    assert x[0] == pytest.approx(erf(0.3), rel=1e-5)


def test_a_fault_is_told_by_the_compiler(pocl: Any) -> None:
    with pytest.raises(cl.RuntimeError, match="undeclared identifier 'y'"):
        build_program(
            pocl, kernel_source("common/vec.cl") + "__kernel void f(void) { int x = y; }", {}
        )


def test_what_is_called_by_a_joined_name_is_inlined(pocl: Any) -> None:
    """PoCL has macros of its own for ``vload`` and others, which a joined name would begin with."""
    kernel = """__kernel void f(__global float *x, __global const uchar *u)
    {
        const vint whole = vec_int_of(vec_load(1, x));
        vec_store(vec_float_of(whole) * vec_load_uchar(2, u), 0, x);
    }"""
    built = build_program(pocl, kernel_source("common/vec_width.cl") + kernel, {"VEC": 8})
    assert "call" not in code(built).split("@f(")[1].split("\n}")[0]
