"""Types in a module's text, and the local and constant arrays that it declares."""

from __future__ import annotations

import re

from gibench.trace.lower import NAME, unquoted

CONSTANT = re.compile(
    rf"^@({NAME}) = (?:(?:private|internal|dso_local|local_unnamed_addr|unnamed_addr) )*"
    rf"constant (\[.*)$",
    re.MULTILINE,
)
_ARGUMENT_SPACES = re.compile(r"!kernel_arg_addr_space !(\d+)")
_CONSTANT_SPACE = "i32 2"
"""Constant memory in an OpenCL kernel's metadata (SPIR 1.2, section 2.2)."""


def nbytes_of(kind: str) -> int:
    """Bytes of a type of the text.

    >>> nbytes_of("<3 x float>"), nbytes_of("[4 x i16]"), nbytes_of("{ i32, float }")
    (12, 8, 8)
    """
    kind = kind.strip()
    if match := re.fullmatch(r"[<\[](\d+) x (.+)[>\]]", kind):
        return int(match[1]) * nbytes_of(match[2])
    if kind.startswith("{"):
        return sum(nbytes_of(part) for part in parts(kind.strip("{} ")))
    named = {"float": 4, "double": 8, "half": 2, "ptr": 8}
    return named[kind] if kind in named else -(-int(kind[1:]) // 8)


def first_type(text: str) -> str:
    """The type at the start of a typed value."""
    if text[0] in "<[{":
        depth = 0
        for place, letter in enumerate(text):
            depth += (letter in "<[{") - (letter in ">]}")
            if depth == 0:
                return text[: place + 1]
    return text.split()[0]


def parts(text: str) -> list[str]:
    """A list of the text at its outer commas."""
    found, depth, start = [], 0, 0
    for place, letter in enumerate(text):
        depth += (letter in "(<[{") - (letter in ")>]}")
        if letter == "," and depth == 0:
            found.append(text[start:place])
            start = place + 1
    return [part.strip() for part in [*found, text[start:]] if part.strip()]


def locals_of(head: str, kernel: str) -> list[tuple[str, int]]:
    """Names and bytes of the local arrays that ``kernel`` declares, in what stands before it."""
    pattern = re.compile(rf'^@"?({re.escape(kernel)}\.[^ "]+)"? = [^\n]*?global (.*)$', re.M)
    return [(name, nbytes_of(first_type(rest))) for name, rest in pattern.findall(head)]


def constants(head: str) -> tuple[tuple[str, int], ...]:
    """Names and bytes of the program's constant arrays, in what stands before a kernel."""
    found = [(unquoted(name), first_type(rest)) for name, rest in CONSTANT.findall(head)]
    return tuple((name, nbytes_of(kind)) for name, kind in found if "%" not in kind)


def constant_args(define: str, tail: str) -> tuple[int, ...]:
    """Numbers of a kernel's arguments in constant memory: its line ``define`` names a list of
    address spaces, which stands in ``tail``, behind it.
    """
    named = _ARGUMENT_SPACES.search(define)
    if named is None:
        return ()
    told = re.search(rf"^!{named[1]} = !{{(.*)}}$", tail, re.MULTILINE)
    assert told is not None
    spaces = told[1].split(", ")
    return tuple(number for number, space in enumerate(spaces) if space == _CONSTANT_SPACE)
