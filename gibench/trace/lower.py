"""PoCL's bitcode of a program, lowered to one kernel as a GPU's compiler would see it.

Everything is inlined but the builtins that are charged by a table; loops are not vectorised, and
unrolled only where that is asked for.
"""

from __future__ import annotations

import re
from typing import Any

from gibench.errors import BadInput
from gibench.trace.charges import builtin_name, is_charged

NAME = r'(?:"[^"]*"|[\w.$-]+)'
_DEFINE = re.compile(rf"^define [^\n@]*@({NAME})\(([^\n]*)\)[^\n]*\{{$")
_KERNEL = re.compile(rf"^define [^\n@]*spir_kernel [^\n@]*@({NAME})\(", re.MULTILINE)
_VLOAD_HALF = re.compile(r"^_Z\d+(?:_cl_)?vload_halfmPU\d+\w+KDh$")
# Software for what every GPU converts in one instruction.
_HALF_BODY = """  %p = getelementptr half, ptr %1, i64 %0
  %h = load half, ptr %p, align 2
  %f = fpext half %h to float
  ret float %f
}"""


def unquoted(name: str) -> str:
    """A name of the text without quotation marks."""
    return name.strip('"')


def lower(bitcode: bytes, kernel: str, unroll: bool = False) -> str:
    """The text of a module that holds ``kernel`` alone, everything inlined into it.

    Args:
        bitcode: of a program.
        kernel: the kernel's name.
        unroll: whether loops are unrolled, as LLVM thinks fit and the source asks.

    Raises:
        BadInput: the program has no such kernel.
    """
    import llvmlite.binding as llvm

    text = str(llvm.parse_bitcode(bitcode))
    if unroll:  # PoCL's compiler forbids it for all loops but those whose source asks for it
        text = text.replace('!"llvm.loop.unroll.disable"', '!"gibench.loop"')
    kernels = [unquoted(name) for name in _KERNEL.findall(text)]
    if kernel not in kernels:
        raise BadInput(f"the program has no kernel '{kernel}'", mend=f"it has {', '.join(kernels)}")
    module = llvm.parse_assembly(_prepared(text, kernel))
    module.verify()
    _optimise(llvm, module, unroll)
    return str(module)


def machine(llvm: Any) -> Any:
    """The target machine of this processor."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=1
    )


def _optimise(llvm: Any, module: Any, unroll: bool) -> None:
    options = llvm.create_pipeline_tuning_options(speed_level=2)
    options.loop_vectorization = False
    options.loop_interleaving = False
    options.slp_vectorization = False
    options.loop_unrolling = unroll
    builder = llvm.create_pass_builder(machine(llvm), options)
    builder.getModulePassManager().run(module, builder)


def _prepared(text: str, kernel: str) -> str:
    """The module's text with linkage and attributes that make everything inline."""
    text = re.sub(r"^attributes #(\d+) = \{(.*)\}$", _attributes, text, flags=re.MULTILINE)
    local = re.compile(
        rf'^@("?{re.escape(kernel)}\.[^ ]+) = internal (?:unnamed_addr )?global (.*)$'
    )
    lines: list[str] = []
    skipping = False
    for line in text.split("\n"):
        if skipping:
            skipping = line != "}"
            continue
        define = _DEFINE.match(line)
        if define is not None:
            line, skipping = _definition(line, unquoted(define[1]), define[2], kernel)
        elif match := local.match(line):
            body = re.sub(r"\b(undef|poison)\b", "zeroinitializer", match[2])
            line = f"@{match[1]} = global {body}"
        elif re.match(r"^@_\w+ = external ", line):
            line = re.sub(r"external (?:local_unnamed_addr )?global (\w+)", _defined, line)
        elif line.startswith("  ") and " call " in line:
            line = re.sub(r"\bnotail call\b|\btail call\b|\bmusttail call\b", "call", line)
        lines.append(line)
    return "\n".join(lines)


def _defined(match: re.Match[str]) -> str:
    kind = match[1]
    return f"global {kind} {'null' if kind == 'ptr' else 0}"


def _attributes(match: re.Match[str]) -> str:
    # Barriers keep their place; no loop becomes a call of memset or memcpy.
    kept = [word for word in ("convergent", "noduplicate") if re.search(rf"\b{word}\b", match[2])]
    memory = re.search(r"\bmemory\([^)]*\)", match[2])
    if memory is not None and not kept:
        kept.append(memory[0])
    return f'attributes #{match[1]} = {{ nounwind {" ".join(kept)} "no-builtins" }}'


def _definition(line: str, name: str, parameters: str, kernel: str) -> tuple[str, bool]:
    """The line that defines a function, and whether its old body is to be left out."""
    if name == kernel:
        return re.sub(r"^define (?:dso_local )?spir_kernel", "define", line), False
    head = re.sub(
        r"^define (?:(?:dso_local|internal|linkonce_odr|linkonce|weak|weak_odr|private|hidden|"
        r"available_externally|spir_kernel|spir_func|protected) )*",
        "define internal ",
        line,
    )
    head = re.sub(r" (?:local_)?unnamed_addr", "", head)
    head = re.sub(r" comdat(?:\([^)]*\))?", "", head)
    charged = is_charged(name, bool(re.search(r"\bptr\b", parameters)))
    word = "noinline" if charged else "alwaysinline"
    if builtin_name(name) is not None and _VLOAD_HALF.match(name):
        return f"define internal float @{name}(i64 %0, ptr %1) alwaysinline {{\n{_HALF_BODY}", True
    if charged:  # its own attributes say that it touches no memory
        return re.sub(r" (#\d+)?( ?)\{$", r" \1 noinline {", head), False
    return re.sub(r"(?: #\d+)?((?: !\w+ !\d+)*) ?\{$", rf" {word} nounwind\1 {{", head), False
