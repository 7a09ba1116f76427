"""What host and kernels share has one home, in Python: kernels get it as a macro."""

import ast
import re
from pathlib import Path

import gibench
from gibench.resources import data

PACKAGE = Path(gibench.__file__).parent
KERNELS = data("kernels_cl")
# What knows of kernels; elsewhere the same word is another thing.
ROOMS = ("device", "rays", "reference", "scene", "techniques")
NUMBER = re.compile(r"\(?-?(0[xX][0-9a-fA-F]+|\d[\d.]*([eE][-+]?\d+)?)[fuUlL]*\)?$")
# By kernel file: names that stand for something else in Python, a field of a row in most.
OTHERS = {
    ("parts/captured_application.cl", "REFLECTED"),
    ("parts/probe_gather.cl", "LEAST_WEIGHT"),
    ("srp/application.cl", "REFLECTED"),
    ("srp/published_transport.cl", "ROWS"),
    ("srp/simt_projection.cl", "PROBES"),
    ("srp/simt_projection.cl", "ROWS"),
    ("srp/simt_transport.cl", "ROWS"),
    ("srp/tuned_projection.cl", "PROBES"),
    ("srp/tuned_projection.cl", "ROWS"),
    ("srp/tuned_transport.cl", "ROWS"),
}


def kernel_files() -> dict[str, str]:
    """The text of every kernel file without its comments, by name."""
    root = Path(str(KERNELS))
    return {
        str(file.relative_to(root)): re.sub(r"//[^\n]*", "", file.read_text())
        for file in sorted(root.rglob("*.cl"))
    }


def literals(text: str) -> set[str]:
    """What ``text`` defines as a number."""
    found = re.findall(r"^[ \t]*#[ \t]*define[ \t]+(\w+)[ \t]+(\S[^\n]*)$", text, re.MULTILINE)
    return {name for name, value in found if NUMBER.match(value.strip())}


def defaults(text: str) -> set[str]:
    """What ``text`` defines where nobody else has: a value that the host may have, too."""
    pairs = re.findall(r"#ifndef (\w+)\s*\n#define (\w+)[ \t]+\S", text)
    return {name for name, again in pairs if name == again}


def is_number(value: ast.expr | None) -> bool:
    """Whether an expression is made of numbers and names alone, or of a range of numbers."""
    parts = (ast.Constant, ast.BinOp, ast.UnaryOp, ast.Name, ast.Tuple, ast.Call)
    kinds = (*parts, ast.operator, ast.unaryop, ast.expr_context)
    nodes = [] if value is None else list(ast.walk(value))
    constants = [one.value for one in nodes if isinstance(one, ast.Constant)]
    calls = [one.func for one in nodes if isinstance(one, ast.Call)]
    return (
        bool(constants)
        and all(isinstance(one, kinds) for one in nodes)
        and all(isinstance(one, int | float) for one in constants)
        and all(isinstance(one, ast.Name) and one.id == "range" for one in calls)
    )


def numbers_of(source: str) -> set[str]:
    """The names of a module's own numbers."""
    names = set()
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and is_number(node.value):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found = (one for target in targets for one in ast.walk(target))
            names |= {one.id.lstrip("_") for one in found if isinstance(one, ast.Name)}
    return names


def known_numbers() -> set[str]:
    """The names of all numbers in the rooms that know of kernels."""
    files = (file for room in ROOMS for file in (PACKAGE / room).rglob("*.py"))
    return {name for file in files for name in numbers_of(file.read_text())}


def test_no_kernel_defines_what_python_knows() -> None:
    known = known_numbers()
    assert {"STACK_ENTRIES", "NO_RAY", "SHADOW_RAY_SHARE", "LEAST_ALPHA"} <= known
    both = {
        (file, name)
        for file, text in kernel_files().items()
        for name in literals(text)
        if name in known
    }
    assert sorted(both - OTHERS) == []
    assert not OTHERS - both, "no longer so"


def test_no_kernel_has_a_default_of_its_own() -> None:
    found = {file: names for file, text in kernel_files().items() if (names := defaults(text))}
    assert found == {}


def test_these_tests_see_what_they_look_for() -> None:
    text = "#define A 12\n  #define B (-1)\n#define C 0x1fu\n#define D 1e-3f\n#define E (A + 1)\n"
    assert literals(text + "#define F(x) 3\n#define G\n") == {"A", "B", "C", "D"}
    source = "A = 1\n_B: Final = 2**24 - 1\nC, D = range(2)\nE = 'a'\nF = f(3)\nG = A\n"
    assert numbers_of(source) == {"A", "B", "C", "D"}
    assert defaults("#ifndef A\n#define A 1\n#endif\n#ifndef GUARD\n#define GUARD\n") == {"A"}
