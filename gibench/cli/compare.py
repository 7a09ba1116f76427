"""``gibench compare``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gibench.cli import options
from gibench.cli.give_comparison import give_comparison


def compare(
    base: Annotated[Path, typer.Argument(metavar="BASE", help="The baseline.")],
    new: Annotated[Path, typer.Argument(metavar="NEW", help="What is judged.")],
    threshold: options.Threshold = "5%",
    seed: options.Seed = 0,
    markdown: options.MarkdownFile = None,
    json: options.JsonFile = None,
    quiet: options.Quiet = False,
) -> None:
    """Compare recorded times, pass by pass, and fail only on an established slowdown.

    BASE and NEW are run folders, JSON files of pytest-benchmark, or folders that hold several of
    them, each one process: three or more processes a side let their spread be measured; with fewer
    it is assumed, and only large changes can be established. On a noisy machine use 'gibench ab',
    which times both sides in turns.

    Exit code 1: a frame or pass is slower beyond the threshold with 99 % confidence, or no longer
    runs. 2: a side is missing or damaged, or they are of different machines, scenes or settings.

    Examples:

      gibench compare results/runs/yesterday results/runs/today --threshold 10%

      gibench compare main.json pull-request.json --markdown comment.md
    """
    from gibench.commands.compare import compare as compare_recorded

    found = compare_recorded(base, new, threshold=threshold, seed=seed)
    give_comparison(found, markdown, json, quiet=quiet)
