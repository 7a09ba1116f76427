"""``gibench history``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gibench.cli import options
from gibench.cli.options import paragraphs

SUMMARY = "Keep runs over weeks, and find the change that made something slower."
_HELP = f"""
{SUMMARY}

A history is one DuckDB file (its name ends in .duckdb) or a folder of Parquet files, which many
machines may write on shared storage at once. Runs of different machines or OpenCL runtimes are kept
side by side and never compared as if they were of one. It needs the extra 'history':
pip install 'gibench[history]'.

Examples:

gibench history add results/runs/*

gibench history check --threshold 5%

gibench history show
"""

app = typer.Typer(rich_markup_mode=None, help=paragraphs(_HELP), no_args_is_help=True)

Kept = Annotated[
    Path,
    typer.Option("--history", metavar="FILE|FOLDER", help="The history."),
]
_DEFAULT = Path("results") / "history.duckdb"


@app.command()
def add(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...",
            help="Run folders, JSON files of pytest-benchmark, or other histories.",
        ),
    ],
    history: Kept = _DEFAULT,
) -> None:
    """Keep runs; what is there already is left as it is."""
    from gibench.commands.history import history_add

    added = history_add(sources, history)
    known = f", {added.known} there already" if added.known else ""
    typer.echo(f"{history}: {added.new} {'run' if added.new == 1 else 'runs'} added{known}")


@app.command()
def check(
    history: Kept = _DEFAULT,
    threshold: options.Threshold = "5%",
    last: Annotated[
        int,
        typer.Option(
            "--last", metavar="N", help="A slowdown fails while at most N runs have followed it."
        ),
    ] = 20,
) -> None:
    """Exit with 1 if a recent step made something slower, and say between which revisions."""
    from gibench.commands.history import history_check

    checked = history_check(history, threshold, last)
    for one in checked.found:
        before, after = one.between
        step = one.step
        typer.echo(
            f"{'slower' if step.slower else 'faster'} x {step.ratio:.3f} "
            f"({step.low:.3f} to {step.high:.3f}), {one.age} runs ago, after {before[:12]} and by "
            f"{after[:12]}: {one.series.name} [{one.series.machine}]"
        )
    short = f"; {checked.short} have too few runs for any" if checked.short else ""
    typer.echo(f"{len(checked.found)} steps in {checked.series} series{short}")
    if checked.error is not None:
        raise checked.error


@app.command()
def show(
    history: Kept = _DEFAULT,
    threshold: options.Threshold = "5%",
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="By default beside the history, .html."),
    ] = None,
) -> None:
    """Write one page: every configuration and pass over time, with its steps. No network needed."""
    from gibench.commands.history import history_page

    typer.echo(str(history_page(history, out, threshold)))
