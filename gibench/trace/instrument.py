"""A kernel's text with a record of every block it runs and every address it touches.

The record is a row of 64-bit words: ``-1 - block`` at the start of every block, then the addresses
of the block's accesses in order. A block always has the same number of accesses, so that its place
is taken at its start and nothing else needs to be told.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from gibench.arrays import Doubles, Longs
from gibench.trace.charges import DIVISION, INTEGER_DIVISION, Charge, charge_of
from gibench.trace.declarations import (
    CONSTANT,
    constant_args,
    constants,
    first_type,
    locals_of,
    nbytes_of,
    parts,
)
from gibench.trace.dependence import BlockLines, Chains, chains_of
from gibench.trace.graph import post_dominators
from gibench.trace.lower import NAME, unquoted

LOAD, STORE, ATOMIC = 0, 1, 2
WORDS_SPARE = 4096
"""Words at the start of the record that take what no longer fits; no block has more accesses."""

_OPERAND = rf"((?:[%@]{NAME})|getelementptr [^()]*\(.*?\)|inttoptr \(.*?\))"
_LOAD = re.compile(
    rf"= load (?:atomic )?(?:volatile )?(.+?), ptr {_OPERAND}(?:,| syncscope| \w+,|$)"
)
_STORE = re.compile(
    rf"^\s*store (?:atomic )?(?:volatile )?(.+), ptr {_OPERAND}(?:,| syncscope| \w+,|$)"
)
_RMW = re.compile(rf"= atomicrmw (?:volatile )?\w+ ptr {_OPERAND}, (\w+) ")
_CMPXCHG = re.compile(rf"= cmpxchg (?:weak )?(?:volatile )?ptr {_OPERAND}, (\w+) ")
_COPY = re.compile(rf"@llvm\.mem(cpy|move|set)\.[\w.]+\(ptr [^%@]*{_OPERAND}, (.*), i64 (\d+), i1")
_CALL = re.compile(rf"\bcall .*?@({NAME})\(")
_OPERATION = re.compile(r"^\s*(?:%\S+|%\"[^\"]*\") = (?:(?:tail|notail) )?(\w+)")
_LABEL = re.compile(rf"^({NAME}):")
_CONSTANT_PLACE = re.compile(r"getelementptr [^%@]*[%@][^,]*(?:, i\d+ -?\d+)+(?:, !|$)")
_OWN = re.compile(r"@_(?:local_id|group_id|local_size|num_groups|global_offset|work_dim)")
_FREE = frozenset(
    [
        "phi",
        "bitcast",
        "freeze",
        "extractelement",
        "insertelement",
        "shufflevector",
        "extractvalue",
        "insertvalue",
        "alloca",
        "load",
        "trunc",
        "zext",
        "ptrtoint",
        "inttoptr",
        "addrspacecast",
    ]
)
_FLOPS = frozenset(("fadd", "fsub", "fmul"))


class TooLarge(ValueError):
    """A block has more accesses than there is room for."""


@dataclass(frozen=True)
class Tables:
    """What is known of a kernel's blocks (b of them) and accesses (a of them) before it runs.

    Attributes:
        first_access: of every block (b,).
        accesses: number of accesses of every block (b,).
        post_dominator: of every block (b,); ``b`` for the end.
        flops: of one lane in every block (b,).
        instructions: issue slots of one lane in every block (b,).
        kind: ``LOAD``, ``STORE`` or ``ATOMIC`` of every access (a,).
        nbytes: of every access (a,).
    """

    first_access: Longs
    accesses: Longs
    post_dominator: Longs
    flops: Doubles
    instructions: Doubles
    kind: Longs
    nbytes: Longs


@dataclass(frozen=True)
class Instrumented:
    """A kernel ready to be compiled and recorded.

    Attributes:
        text: of the module.
        tables: of its blocks and accesses.
        chains: which of its loads wait for which.
        has_barriers: whether its work-items wait for each other.
        locals: names and bytes of the local arrays that the kernel declares itself.
        constants: names and bytes of the program's own constant arrays.
        constant_args: numbers of the arguments that lie in constant memory.
    """

    text: str
    tables: Tables
    chains: Chains
    has_barriers: bool
    locals: tuple[tuple[str, int], ...]
    constants: tuple[tuple[str, int], ...]
    constant_args: tuple[int, ...]


@dataclass
class _Block:
    lines: list[str] = field(default_factory=list)
    accesses: list[tuple[int, int]] = field(default_factory=list)
    instructions_in_order: list[tuple[str, tuple[int, ...]]] = field(default_factory=list)
    targets: list[str] = field(default_factory=list)
    flops: float = 0.0
    instructions: float = 0.0
    label: str = ""


def instrument(text: str, kernel: str) -> Instrumented:
    """Put the record into the lowered module ``text`` and add what starts its work-items.

    Raises:
        ValueError: the kernel is not in it.
    """
    text = re.sub(
        r"^attributes (#\d+) = \{.*\}$", r"attributes \1 = { nounwind }", text, flags=re.M
    )
    text = CONSTANT.sub(r"@\1 = constant \2", text)  # found by name
    head, body, tail, define = _split(text, kernel)
    blocks = _blocks(body)
    tables = _tables(blocks)
    lines = [define]
    for number, block in enumerate(blocks):
        lines += [*_recorded(block, number), ""]
    lines.append("}")
    runtime = _runtime(define, kernel, head + tail)
    joined = "\n".join([head, *lines, tail, runtime])
    barriers = any("@pocl.barrier(" in line for line in body)
    local = tuple(locals_of(head, kernel))
    return Instrumented(
        joined, tables, _chains(blocks, tables), barriers, local,
        constants(head), constant_args(define, tail),
    )  # fmt: skip


def _chains(blocks: list[_Block], tables: Tables) -> Chains:
    given = []
    for block, first in zip(blocks, tables.first_access.tolist(), strict=True):
        lines = [
            (line, tuple(first + place for place in loads))
            for line, loads in block.instructions_in_order
        ]
        given.append(BlockLines(block.label, lines))
    return chains_of(given, len(tables.kind))


def _split(text: str, kernel: str) -> tuple[str, list[str], str, str]:
    """What stands before the kernel, its body, what stands behind, the line that defines it."""
    lines = text.split("\n")
    pattern = re.compile(rf'^define [^@]*@"?{re.escape(kernel)}"?\(')
    start = next((n for n, line in enumerate(lines) if pattern.match(line)), None)
    if start is None:
        raise ValueError(f"no kernel {kernel}")
    end = lines.index("}", start)
    return (
        "\n".join(lines[:start]),
        lines[start + 1 : end],
        "\n".join(lines[end + 1 :]),
        lines[start],
    )


def _blocks(body: list[str]) -> list[_Block]:
    found = [_Block()]
    switch = False
    for line in body:
        stripped = line.strip()
        if not stripped or stripped.startswith(";"):
            continue
        if (label := _LABEL.match(line)) and not switch:
            if found[-1].lines or found[-1].label:
                found.append(_Block())
            found[-1].label = unquoted(label[1])
            found[-1].lines.append(line)
            continue
        block = found[-1]
        line = re.sub(r", !(?!llvm)[\w.]+ !\d+", "", line)
        if switch or stripped.startswith(("br ", "switch ")):
            block.targets += [unquoted(name) for name in re.findall(rf"label %({NAME})", line)]
            switch = stripped.endswith("[") or (switch and not stripped.startswith("]"))
            if "label" in line and not stripped.startswith("br label"):
                block.instructions += 1
        _look(block, line)
    return found


def _look(block: _Block, line: str) -> None:
    """Add a line to its block, a record of what it touches before it, and its cost."""
    loads = []
    for kind, operand, nbytes in _touched(line):
        place, base = len(block.accesses) + 1, f"%t.B.a{len(block.accesses)}"
        block.lines += [
            f"  {base} = ptrtoint ptr {operand} to i64",
            f"  {base}.p = getelementptr i64, ptr %t.B.r, i64 {place}",
            f"  store i64 {base}, ptr {base}.p",
        ]
        if kind != STORE:
            loads.append(len(block.accesses))
        block.accesses.append((kind, nbytes))
        block.instructions += max(1, -(-nbytes // 16))
    block.lines.append(line)
    block.instructions_in_order.append((line, tuple(loads)))
    charge, width = _cost(line)
    block.flops += charge.flops * width
    block.instructions += charge.instructions * width


def _touched(line: str) -> list[tuple[int, str, int]]:
    """What a line touches: kind, operand, bytes."""
    if match := _LOAD.search(line):
        found = [(LOAD, match[2], nbytes_of(match[1]))]
    elif match := _STORE.match(line):
        found = [(STORE, match[2], nbytes_of(first_type(match[1])))]
    elif match := _RMW.search(line) or _CMPXCHG.search(line):
        found = [(ATOMIC, match[1], nbytes_of(match[2]))]
    elif match := _COPY.search(line):
        found = [(STORE, match[2], int(match[4]))]
        source = re.search(rf"ptr [^%@]*{_OPERAND}$", match[3])
        if match[1] != "set" and source is not None:
            found.insert(0, (LOAD, source[1], int(match[4])))
    else:
        return []
    return [each for each in found if not _OWN.match(each[1])]


def _cost(line: str) -> tuple[Charge, int]:
    """What one lane pays for a line, and for how many components; accesses pay for themselves."""
    nothing = Charge(0, 0), 1
    operation = _OPERATION.match(line)
    call = _CALL.search(line)
    widths = [int(n) for n in re.findall(r"<(\d+) x ", line.split(", align")[0])]
    width = max(widths, default=1)
    if call is not None:
        charge = charge_of(unquoted(call[1]))
        return nothing if charge is None else (charge, width)
    if operation is None:
        return nothing
    name = operation[1]
    if name in _FREE or name in ("atomicrmw", "cmpxchg"):
        return nothing
    if name in _FLOPS:
        return Charge(1, 1), width
    if name in ("fdiv", "frem"):
        return DIVISION, width
    if name in ("sdiv", "udiv", "srem", "urem"):
        constant = re.search(r", -?\d+$", line.strip()) is not None  # a multiplication and a shift
        return (Charge(0, 3) if constant else INTEGER_DIVISION), width
    if name == "getelementptr":  # a constant distance is part of the access
        return Charge(0, 0 if _CONSTANT_PLACE.search(line) else 1), 1
    return Charge(0, 1), width


def _recorded(block: _Block, number: int) -> list[str]:
    """The block's lines with its place in the record taken after its phis."""
    lines = [re.sub(r"%t\.B\.", f"%t.{number}.", line) for line in block.lines]
    at = 1 if block.label else 0
    while at < len(lines) and " = phi " in lines[at]:
        at += 1
    t = f"%t.{number}."
    taken = [
        f"  {t}n = load i64, ptr @__trace_count",
        f"  {t}e = add i64 {t}n, {len(block.accesses) + 1}",
        f"  store i64 {t}e, ptr @__trace_count",
        f"  {t}c = load i64, ptr @__trace_capacity",
        f"  {t}o = icmp ule i64 {t}e, {t}c",
        f"  {t}s = select i1 {t}o, i64 {t}n, i64 0",
        f"  {t}b = load ptr, ptr @__trace_words",
        f"  {t}r = getelementptr i64, ptr {t}b, i64 {t}s",
        f"  store i64 {-1 - number}, ptr {t}r",
    ]
    return [*lines[:at], *taken, *lines[at:]]


def _tables(blocks: list[_Block]) -> Tables:
    places = {block.label: number for number, block in enumerate(blocks)}
    counts = np.array([len(block.accesses) for block in blocks], np.int64)
    accesses = [each for block in blocks for each in block.accesses]
    if counts.max(initial=0) + 1 > WORDS_SPARE:
        raise TooLarge("a block has too many accesses")
    return Tables(
        first_access=np.cumsum(counts) - counts,
        accesses=counts,
        post_dominator=post_dominators([[places[t] for t in block.targets] for block in blocks]),
        flops=np.array([block.flops for block in blocks]),
        instructions=np.array([block.instructions for block in blocks]),
        kind=np.array([kind for kind, _ in accesses], np.int64),
        nbytes=np.array([nbytes for _, nbytes in accesses], np.int64),
    )


def _runtime(define: str, kernel: str, rest: str) -> str:
    """The record's own variables, and functions that run one work-item or a group of them."""
    inside = re.search(r"\((.*)\)[^()]*\{$", define)
    assert inside is not None
    kinds = [first_type(part) for part in parts(inside[1])]
    lines, values = [], []
    for number, kind in enumerate(kinds):
        lines += [
            f"  %p{number} = getelementptr ptr, ptr %args, i64 {number}",
            f"  %q{number} = load ptr, ptr %p{number}",
            f"  %v{number} = load {kind}, ptr %q{number}, align 1",
        ]
        values.append(f"{kind} %v{number}")
    own = [
        *(f"_{what}_{axis}" for what in _ITEM_WORDS for axis in "xyz"),
    ]
    missing = [f"@{name} = global i64 0" for name in own if f"@{name} = " not in rest]
    missing += [f"@{name} = global i32 0" for name in (WORK_DIM,) if f"@{name} = " not in rest]
    call = f'  call void @"{kernel}"({", ".join(values)})'
    return "\n".join((*missing, _VARIABLES, "define void @__trace_item(ptr %args) {", *lines, call,
                      "  ret void", "}", _GROUP))  # fmt: skip


_ITEM_WORDS = ("local_id", "group_id", "local_size", "num_groups", "global_offset")
WORK_DIM = "_work_dim"
_VARIABLES = """@__trace_count = global i64 0
@__trace_capacity = global i64 0
@__trace_words = global ptr null"""
_GROUP = """define void @__trace_group(ptr %args, i64 %items, ptr %starts) {
entry:
  br label %loop
loop:
  %i = phi i64 [ 0, %entry ], [ %next, %loop ]
  %width = load i64, ptr @_local_size_x
  %height = load i64, ptr @_local_size_y
  %x = urem i64 %i, %width
  %row = udiv i64 %i, %width
  %y = urem i64 %row, %height
  %z = udiv i64 %row, %height
  store i64 %x, ptr @_local_id_x
  store i64 %y, ptr @_local_id_y
  store i64 %z, ptr @_local_id_z
  %n = load i64, ptr @__trace_count
  %s = getelementptr i64, ptr %starts, i64 %i
  store i64 %n, ptr %s
  call void @__trace_item(ptr %args)
  %next = add i64 %i, 1
  %more = icmp ult i64 %next, %items
  br i1 %more, label %loop, label %end
end:
  ret void
}"""
