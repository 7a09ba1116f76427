"""Papers are cited by authors and year, and every one of them is in docs/references.md."""

from __future__ import annotations

import re
import unicodedata
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ITSELF = Path(__file__).resolve()
FOLDERS = ("gibench", "kernels_cl", "scenes", "tests", "docs", "results/published")
KINDS = {".py", ".cl", ".toml", ".md", ".csv", ".html", ".js", ".css"}

PRIVATE = re.compile(
    r"\bpapers?:|\bpaper \d|(?<!master's )(?<!phd )\bthesis\b(?!\.txt)|\bissue \d", re.I
)
"""Which of them? Only the writer knows."""
NOT_OURS = "PoCL issue"

YEAR = r"(?:19[4-9]\d|20[0-2]\d)"
NAME = r"[^\W\d_a-z][\w'-]*\w"
CITED = re.compile(
    rf"\b((?:{NAME}, )*{NAME}(?:,? and {NAME}| et al\.)?),? \(?({YEAR})\b(?!\s*(?:x|W|ms|%))"
)


def plain(text: str) -> str:
    """The text without accents, line ends or comment marks, so that a citation may be broken."""
    text = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    return re.sub(r"\s*\n[ \t]*(?:(?://+|#:?|\*)[ \t])?[ \t]*", " ", text).replace('" "', "")


def sources() -> list[Path]:
    """What a reader or user of gibench meets, this file apart."""
    found = [ROOT / name for name in ("README.md", "ARCHITECTURE.md", "pyproject.toml")]
    for folder in FOLDERS:
        found += [path for path in (ROOT / folder).rglob("*") if path.suffix in KINDS]
    return sorted(path for path in found if path.resolve() != ITSELF)


@cache
def references() -> tuple[str, ...]:
    """One work a line."""
    text = (ROOT / "docs" / "references.md").read_text(encoding="utf-8")
    return tuple(plain(line) for line in text.splitlines() if line.startswith("- "))


def known(names: str, year: str) -> bool:
    """Whether one work of that year has all these names (or is of this venue)."""
    words = re.findall(NAME, names.replace(" et al.", "").replace(" and ", ", ").replace("'s", ""))
    return any(year in line and all(word in line for word in words) for line in references())


def unknown(text: str) -> list[str]:
    """Citations in a text that no reference answers."""
    return [
        f"{names} {year}" for names, year in CITED.findall(plain(text)) if not known(names, year)
    ]


def private(text: str) -> list[str]:
    """Citations in a text by a number of our own."""
    text = plain(text)
    return [
        text[max(0, found.start() - 30) : found.end() + 10]
        for found in PRIVATE.finditer(text)
        if not text[: found.end()].endswith(NOT_OURS + found.group()[len("issue") :])
    ]


@pytest.mark.parametrize("folder", ("", *FOLDERS))
def test_no_work_is_cited_by_a_number_of_our_own(folder: str) -> None:
    found = {str(path): private(path.read_text(encoding="utf-8")) for path in _within(folder)}
    assert not {path: lines for path, lines in found.items() if lines}


@pytest.mark.parametrize("folder", ("", "gibench", "kernels_cl", "scenes", "tests", "docs"))
def test_every_work_cited_is_in_the_references(folder: str) -> None:
    paths = [path for path in _within(folder) if path.suffix in (".py", ".cl", ".toml", ".md")]
    found = {str(path): unknown(path.read_text(encoding="utf-8")) for path in paths}
    assert not {path: lines for path, lines in found.items() if lines}


def test_citations_are_seen_wherever_they_break() -> None:
    assert unknown("as in Nobody and\n// Noone 2019, section 3") == ["Nobody and Noone 2019"]
    assert unknown("# (Nobody et al.\n# 2019)") == ["Nobody et al. 2019"]
    assert unknown("(Ekberg\n    2022) and Künsch 1989; Kalibera and Jones, ISMM 2013") == []
    assert unknown("Ekberg 2021") == ["Ekberg 2021"]
    assert private("(paper 004, section 3)") and private("as in the\n// thesis, section 5")
    assert private("acceptance of issue 2") and not private("a bug (PoCL issue 1049)")


def test_no_work_is_listed_twice() -> None:
    names = [line.split("**")[1] for line in references()]
    assert len(names) == len(set(names))


def _within(folder: str) -> list[Path]:
    """The sources below a folder; for no folder those at the top."""
    if not folder:
        return [path for path in sources() if path.parent == ROOT]
    return [path for path in sources() if path.is_relative_to(ROOT / folder)]
