"""``gibench merge``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gibench.errors import printable


def merge(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Folders that --shard left: all of them.")
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="The folder of the whole.")
    ],
) -> None:
    """Join shards of run, experiment or advise into one folder.

    Shards that do not belong together are refused, and which: of another machine, OpenCL device,
    revision, seed or question, there twice, missing or unfinished.

    Example:

      gibench merge shard-1 shard-2 shard-3 --out whole
    """
    from gibench.commands.merge import merge as join

    merged = join(runs, out)
    asked = merged.record["arguments"]
    if merged.is_run:
        typer.echo(
            f"{merged.shards} shards, {merged.total} configurations; "
            f"see {printable(str(merged.folder.path))}"
        )
        return
    command = f"experiment {asked['experiment']}" if "experiment" in asked else "advise"
    typer.echo(
        f"{merged.shards} shards, {merged.total} points in {merged.folder.path}; the same 'gibench "
        f"{command}' without --shard and with --out {merged.folder.path} writes the report and "
        "measures nothing again"
    )
