"""Which tests notice a kernel that returns at once, or a statistic that returns a constant.

A statistic has two mutants: one that returns the number 0.5, and ``:first``, which returns what the
first call in the run returned, of the right type and shape, for ever.

A pytest plug-in and a script. The script runs given tests once as they are, then once for every
mutant, all in one process a mutant, and writes a table: mutant, whether a test failed, and the
first that did (the run ends there). What no test notices is printed.

Usage (in the repository's root)::

    python tests/support/kernel_mutants.py kernels OUT.csv ddgi tests/techniques/ddgi
    python tests/support/kernel_mutants.py statistics OUT.csv \
        gibench.measure.statistics,gibench.measure.compare.paired tests/measure
    python tests/support/kernel_mutants.py compare BEFORE.csv AFTER.csv

The second argument of ``kernels`` is a folder or a file of kernels_cl or names with commas between
them (``ddgi/trace.cl:probe_trace``), that of ``statistics`` modules or packages. Rows of OUT.csv
that are of other mutants stay. Options of pytest may follow the tests. ``compare`` fails where a
mutant was caught in BEFORE and is not in AFTER.
"""

from __future__ import annotations

import csv
import importlib
import os
import pkgutil
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
KERNEL = re.compile(
    r"^\s*(?:__)?kernel\b\s*(?:__attribute__\(\((?:[^()]|\([^()]*\))*\)\)\s*)?void\s+(\w+)\s*\(",
    re.MULTILINE,
)
MUTANT = "GIBENCH_MUTANT"
FIRST = ":first"


def body_of(source: str, start: int) -> int:
    """Where the body of a kernel begins, after its brace; ``start`` is after the name's bracket."""
    depth, place = 1, start
    while depth:
        depth += {"(": 1, ")": -1}.get(source[place], 0)
        place += 1
    return source.index("{", place) + 1


def kernels(where: str) -> list[str]:
    """``file:kernel`` of every kernel of a file of kernels_cl, or beneath a folder of it."""
    if ":" in where:
        return where.split(",")
    root = ROOT / "kernels_cl"
    place = root / where
    return [
        f"{path.relative_to(root).as_posix()}:{found[1]}"
        for path in ([place] if place.is_file() else sorted(place.rglob("*.cl")))
        for found in KERNEL.finditer(path.read_text())
    ]


def statistics(where: str) -> list[str]:
    """Both mutants of every public function of modules and of packages' modules.

    Args:
        where: names of modules and packages, with commas between them.
    """
    names = []
    for name in where.split(","):
        module = importlib.import_module(name)
        names.append(name)
        if hasattr(module, "__path__"):
            names += [f"{name}.{one.name}" for one in pkgutil.iter_modules(module.__path__)]
    return [
        f"{one}:{key}{kind}"
        for one in names
        for key, value in vars(importlib.import_module(one)).items()
        if callable(value)
        and not key.startswith("_")
        and not isinstance(value, type)
        and getattr(value, "__module__", "") == one
        for kind in ("", FIRST)
    ]


def mutate_kernels(file: str, kernel: str) -> None:
    """From now on ``kernel_source`` gives the kernel a ``return;`` at its start."""
    source_module = importlib.import_module("gibench.device.source")
    plain = source_module.kernel_source

    def mutated(path: str, *args: Any, **kwargs: Any) -> str:
        text = plain(path, *args, **kwargs)
        at, here = 0, ""
        for mark in re.finditer(r'^#line \d+ "([^"]+)"$|' + KERNEL.pattern, text, re.MULTILINE):
            here = mark[1] or here
            if mark[2] == kernel and here == file:
                at = body_of(text, mark.end())
        return text[:at] + " return; " + text[at:] if at else text

    replace_everywhere(plain, mutated)


def mutate_statistic(module: str, function: str) -> None:
    """From now on a function returns 0.5, or its first answer, whatever is asked."""
    name = function.removesuffix(FIRST)
    plain = getattr(importlib.import_module(module), name)
    answers: list[Any] = [] if function.endswith(FIRST) else [0.5]

    def constant(*args: Any, **kwargs: Any) -> Any:
        if not answers:
            answers.append(plain(*args, **kwargs))
        return answers[0]

    replace_everywhere(plain, constant)


def replace_everywhere(plain: Any, other: Any) -> None:
    """In every module of gibench that has it, by whatever name."""
    load_all()
    for name, module in list(sys.modules.items()):
        if name.startswith("gibench"):
            for key, value in list(vars(module).items()):
                if value is plain:
                    setattr(module, key, other)


def pytest_configure() -> None:
    """Called where this file is loaded as a plug-in: makes the mutant that the variable names."""
    first, _, second = os.environ.get(MUTANT, "").partition(":")
    if first.endswith(".cl"):
        mutate_kernels(first, second)
    elif first:
        mutate_statistic(first, second)


def load_all() -> None:
    """Import what tests import, once for all mutants."""
    package = importlib.import_module("gibench")
    for one in pkgutil.walk_packages(package.__path__, "gibench."):
        if one.name != "gibench.__main__":
            importlib.import_module(one.name)


def failures(mutant: str, tests: list[str]) -> list[str]:
    """The first test that fails, or none; run in a fork, which loads nothing again."""
    with tempfile.NamedTemporaryFile("r", suffix=".txt") as told:
        if (child := os.fork()) == 0:
            file = os.open(told.name, os.O_WRONLY)
            os.dup2(file, 1)
            os.dup2(file, 2)
            os.environ[MUTANT] = mutant
            options = ["-q", "--no-header", "-p", "no:cacheprovider", "-x", "--tb=no", "-rfE"]
            plugin = ["-p", "support.kernel_mutants", "-m", "not slow"]
            code = int(pytest.main([*options, *plugin, *tests]))
            sys.stdout.flush()
            os._exit(code)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        lines = told.read().splitlines()
    if code < 0:
        return [f"ended by signal {-code}"]
    if code not in (0, 1):
        raise SystemExit(f"{mutant}: pytest failed ({code}):\n" + "\n".join(lines[-20:]))
    told = [line.split(" ", 1)[1] for line in lines if line.startswith(("FAILED ", "ERROR "))]
    found = [line.split(" - ")[0] for line in told]  # names of tests may hold spaces
    return found[:1]


def record(mutants: list[str], out: Path, tests: list[str]) -> None:
    """Run ``tests`` for each mutant and write the table."""
    load_all()
    if broken := failures("", tests):
        raise SystemExit(f"they fail without a mutant: {broken[:5]}")
    rows: dict[str, list[str]] = {}
    if out.exists():
        with out.open(newline="") as file:
            rows = {row["mutant"]: list(row.values()) for row in csv.DictReader(file)}
    for mutant in mutants:
        found = failures(mutant, tests)
        rows[mutant] = [mutant, str(int(bool(found))), "".join(found)]
        print(mutant, *(found or ["NOT NOTICED"]), flush=True)
        with out.open("w", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(["mutant", "noticed", "by"])
            table.writerows(rows[name] for name in sorted(rows))


def lost(before: Path, after: Path) -> list[str]:
    """The mutants that tests noticed in ``before`` and do not in ``after``."""
    caught = []
    for path in (before, after):
        with path.open(newline="") as file:
            caught.append({row["mutant"]: row["noticed"] == "1" for row in csv.DictReader(file)})
    return [name for name, was in caught[0].items() if was and not caught[1].get(name, False)]


def main(what: str, *arguments: str) -> None:
    """See the file's docstring."""
    if what == "compare":
        if missed := lost(Path(arguments[0]), Path(arguments[1])):
            raise SystemExit("no longer noticed: " + ", ".join(missed))
        return
    out, where, *tests = arguments
    record((kernels if what == "kernels" else statistics)(where), Path(out), tests)


if __name__ == "__main__":
    sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
    main(*sys.argv[1:])
