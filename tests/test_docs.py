"""Pages name files, commands and options that are there."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer

from gibench.cli.main import app

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "ARCHITECTURE.md", *sorted((ROOT / "docs").glob("*.md"))]

LINK = re.compile(r"\]\((?!https?:|#)([^)#\s]+)[^)]*\)")
NAMED = re.compile(r"`((?:gibench|kernels_cl|tests|scenes|docs|results)/[\w./-]+)`")
BLOCK = re.compile(r"^```(sh|console)\n(.*?)^```", re.M | re.S)


def commands(text: str) -> list[list[str]]:
    """The gibench commands of a page's blocks, in words."""
    found = []
    for kind, block in BLOCK.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            if kind == "console" and not line.startswith("$ "):
                continue  # what a command printed
            for part in line.removeprefix("$ ").split("&&" if "&&" in line else "; "):
                words = shlex.split(part, comments=True) if "gibench " in part else []
                if words and words[0].rpartition("/")[2] == "gibench":
                    found.append(words[1:])
    return found


def options_of(words: list[str]) -> set[str]:
    """Every option of the command that these words name.

    Raises:
        KeyError: there is no such command.
    """
    command: Any = typer.main.get_command(app)
    for word in words:
        if word.startswith("-") or not hasattr(command, "commands"):
            break
        command = command.commands[word]
    given = [name for one in command.params for name in (*one.opts, *one.secondary_opts)]
    return {"-h", "--help", *given}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_a_page_links_to_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert not [link for link in LINK.findall(text) if not (page.parent / link).exists()]
    made = ("results/runs", "results/experiments")  # by a run
    named = [name for name in NAMED.findall(text) if not name.startswith(made)]
    assert not [name for name in named if not (ROOT / name).exists() and "NAME" not in name]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_pages_commands_have_the_options_it_gives(page: Path) -> None:
    for words in commands(page.read_text(encoding="utf-8")):
        given = {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)}
        assert given <= options_of(words), words


def test_commands_are_found_in_pages() -> None:
    text = "```sh\ngibench ab HEAD~1 -t direct  # so\n.venv/bin/gibench run \\\n  --scene x\n```"
    assert commands(text) == [["ab", "HEAD~1", "-t", "direct"], ["run", "--scene", "x"]]
    assert "--technique" in options_of(["ab"]) and "--toml" in options_of(["profiles", "show"])
    with pytest.raises(KeyError):
        options_of(["nosuch"])
