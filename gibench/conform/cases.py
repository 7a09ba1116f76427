"""Which cases there are, and which kernels."""

from __future__ import annotations

import pkgutil
import re
from collections.abc import Iterator
from importlib import import_module
from importlib.resources.abc import Traversable
from importlib.util import find_spec

import gibench.techniques
from gibench.conform import parts, rays, recolour, reference, refit, roofs
from gibench.techniques.parts.conformance.case import Case

_KERNEL = re.compile(r"__kernel\b\s*(?:__attribute__\(\((?:[^()]|\([^()]*\))*\)\)\s*)?void\s+(\w+)")


def cases() -> dict[str, Case]:
    """Every case by name: the shared ones, then those that techniques bring in their folders."""
    found = [*parts.CASES, *rays.CASES, *refit.CASES, *roofs.CASES, *reference.CASES]
    found += recolour.CASES
    folder = gibench.techniques
    for module in pkgutil.iter_modules(folder.__path__):
        name = f"{folder.__name__}.{module.name}.conform"
        if module.ispkg and find_spec(name) is not None:
            found += import_module(name).CASES
    return {case.name: case for case in found}


def kernels(root: Traversable) -> list[str]:
    """Every kernel of a kernel tree, as ``file.cl:name``."""
    return sorted(_within(root, ""))


def _within(folder: Traversable, prefix: str) -> Iterator[str]:
    for entry in folder.iterdir():
        if entry.is_dir():
            yield from _within(entry, f"{prefix}{entry.name}/")
        elif entry.name.endswith(".cl"):
            for name in _KERNEL.findall(entry.read_text(encoding="utf-8")):
                yield f"{prefix}{entry.name}:{name}"
