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

The second argument of ``kernels`` is a folder or a file of kernels_cl, that of ``statistics``
modules or packages. Options of pytest may follow the tests. ``compare`` fails where a mutant was
caught in BEFORE and is not in AFTER.
"""

from __future__ import annotations

import csv
import importlib
import os
import pkgutil
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

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
    package = importlib.import_module("gibench")
    for one in pkgutil.walk_packages(package.__path__, "gibench."):
        if one.name != "gibench.__main__":
            importlib.import_module(one.name)
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


def failures(mutant: str, tests: list[str]) -> list[str]:
    """The first test that fails, or none."""
    with tempfile.NamedTemporaryFile("r", suffix=".txt") as told:
        environment = dict(os.environ)
        environment[MUTANT] = mutant
        environment["PYTHONPATH"] = os.pathsep.join(
            [str(ROOT), str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")]
        )
        command = [sys.executable, "-m", "pytest", "-q", "--no-header", "-p", "no:cacheprovider"]
        options = ["-x", "-p", "support.kernel_mutants", "--tb=no", "-rfE", "-m", "not slow"]
        with Path(told.name).open("w") as log:
            ran = subprocess.run(
                [*command, *options, *tests], cwd=ROOT, env=environment, stdout=log, stderr=log
            )
        lines = told.read().splitlines()
    if ran.returncode not in (0, 1):
        raise SystemExit(f"{mutant}: pytest failed ({ran.returncode}):\n" + "\n".join(lines[-20:]))
    found = [line.split(" ")[1] for line in lines if line.startswith(("FAILED ", "ERROR "))]
    return found[:1]


def record(mutants: list[str], out: Path, tests: list[str]) -> None:
    """Run ``tests`` for each mutant and write the table."""
    if broken := failures("", tests):
        raise SystemExit(f"they fail without a mutant: {broken[:5]}")
    with out.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["mutant", "noticed", "by"])
        for mutant in mutants:
            found = failures(mutant, tests)
            table.writerow([mutant, int(bool(found)), "".join(found)])
            file.flush()
            print(mutant, *(found or ["NOT NOTICED"]), flush=True)


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
    main(*sys.argv[1:])
