"""What 'gibench ab' and 'gibench compare' share: the threshold and where results are written."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Mapping

Threshold = Annotated[
    str,
    typer.Option(
        "--threshold", metavar="PERCENT", help="The least change that matters, for instance 5%."
    ),
]
MarkdownFile = Annotated[
    Path | None,
    typer.Option(
        "--markdown",
        metavar="FILE",
        help="Write a table for a pull request; - for standard output.",
    ),
]
JsonFile = Annotated[
    Path | None,
    typer.Option("--json", metavar="FILE", help="Write everything as JSON; - for standard output."),
]


def write_comparison(
    markdown: Path | None, text: str, json_file: Path | None, content: Mapping[str, object]
) -> None:
    """Write a comparison where it was asked for.

    Raises:
        GibenchError: it cannot be written.
    """
    import json

    from gibench.measure.runfolder.folder import write_atomically

    whole = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    for path, written in ((markdown, text), (json_file, whole)):
        if path == Path("-"):
            typer.echo(written, nl=False)
        elif path is not None:
            write_atomically(path, written.encode())
