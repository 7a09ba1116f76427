"""What docstrings, pages and comments name by its full path is there."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
ROLE = re.compile(r":(?:func|class|mod|meth|attr|data):`~?(gibench(?:\.\w+)+)`")
FILE = re.compile(r"\b(?:kernels_cl|gibench|tests|docs)/[\w/.-]*\w\.(?:py|cl|md|csv|toml)\b")


def found(name: str) -> Any:
    """The module or what of one has this name.

    Raises:
        AttributeError, ImportError: there is none.
    """
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            value: Any = import_module(".".join(parts[:count]))
        except ModuleNotFoundError as error:
            if not name.startswith(str(error.name)):
                raise
            continue
        for part in parts[count:]:
            fields = getattr(value, "__dataclass_fields__", {})
            value = None if part in fields else getattr(value, part)
        return value
    raise ImportError(name)


def missing(text: str) -> set[str]:
    """What ``text`` names that is not there."""
    lost = {name for name in FILE.findall(text) if not (ROOT / name).exists()}
    for name in set(ROLE.findall(text)):
        try:
            found(name)
        except (AttributeError, ImportError):
            lost.add(name)
    return lost


def test_what_is_named_is_there() -> None:
    files = [*(ROOT / "gibench").rglob("*.py"), *(ROOT / "kernels_cl").rglob("*.cl")]
    files += [ROOT / "ARCHITECTURE.md", ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    files.remove(ROOT / "docs" / "adding-a-technique.md")  # it names files that are to be made
    lost = {file.name: names for file in files if (names := missing(file.read_text("utf-8")))}
    assert not lost
    text = (
        ":func:`gibench.errors.nowhere` in gibench/nowhere.py and :class:`gibench.errors.BadInput`"
    )
    assert missing(text) == {"gibench.errors.nowhere", "gibench/nowhere.py"}
    assert missing(":attr:`gibench.measure.session.session.Session.notes`") == set()
