"""OpenCL C sources: found as package data, `#include`s resolved here.

Includes are resolved in Python rather than by ``-I`` so that one string holds all that a program
is built from: it can be hashed, cached, compared between revisions and built from a zipped wheel.
"""

from __future__ import annotations

import hashlib
import re
from importlib.resources.abc import Traversable
from pathlib import Path

from gibench.errors import GibenchError
from gibench.resources import data

# Begin every program; trees of revisions before them have none.
_PRELUDE = ("common/declared.cl", "common/builtins.cl")
_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$', re.MULTILINE)


def kernel_source(path: str, root: Traversable | None = None) -> str:
    """The source of ``path`` with every ``#include "..."`` expanded once, after the builtins that
    are declared and inlined (``common/declared.cl``, ``common/builtins.cl``).

    Args:
        path: file beneath ``kernels_cl``, for instance ``"srp/tuned.cl"``. Includes are named the
            same way, from the top of ``kernels_cl``.
        root: another kernel tree than the installed one.

    Raises:
        GibenchError: a file is missing.
    """
    tree, seen = data("kernels_cl") if root is None else root, set[str]()
    prelude = [file for file in _PRELUDE if tree.joinpath(*file.split("/")).is_file()]
    return "".join(_expand(file, tree, seen) for file in (*prelude, path))


def _expand(path: str, root: Traversable, seen: set[str]) -> str:
    if path in seen:
        return ""
    seen.add(path)
    file = root.joinpath(*path.split("/"))
    if not file.is_file():
        raise GibenchError(f"kernel source '{path}' is missing from {root}")

    text = file.read_text(encoding="utf-8")

    def included(match: re.Match[str]) -> str:
        # The line after the include: messages then name the file and line a reader knows.
        after = text.count("\n", 0, match.end()) + 2
        return f'\n{_expand(match.group(1), root, seen)}#line {after} "{path}"'

    return f'#line 1 "{path}"\n{_INCLUDE.sub(included, text)}\n'


def tree_hash(root: Path) -> str:
    """SHA-256 of the names and content of every source beneath ``root``."""
    found = hashlib.sha256()
    for file in sorted(root.rglob("*.cl")):
        found.update(f"{file.relative_to(root).as_posix()}\0".encode())
        found.update(hashlib.sha256(file.read_bytes()).digest())
    return found.hexdigest()
