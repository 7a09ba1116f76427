"""Imports: no circles, and the contracts of pyproject.toml hold."""

from __future__ import annotations

import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
import pytest


def test_no_modules_import_each_other_in_a_circle() -> None:
    graph = grimp.build_graph("gibench", cache_dir=None)
    imports = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    assert len(imports) > 250
    TopologicalSorter(imports).prepare()  # raises, naming the circle
    imports["gibench.errors"].add("gibench.cli.main")
    with pytest.raises(CycleError, match=r"gibench\.cli\.main"):
        TopologicalSorter(imports).prepare()


def test_the_contracts_hold() -> None:
    root = Path(__file__).parents[1]
    command = "from importlinter.cli import lint_imports; exit(lint_imports())"
    checked = subprocess.run(
        [sys.executable, "-c", command], cwd=root, capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stdout[-2000:]
    assert ", 0 broken" in checked.stdout
