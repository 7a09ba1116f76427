"""How 'gibench ab' and 'gibench compare' give what they found: files, terminal, exit code."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from gibench.report.comparison import Comparison


def give_comparison(
    found: Comparison, markdown: Path | None, json_file: Path | None, *, quiet: bool
) -> None:
    """Write a comparison where it was asked for, and show it unless standard output is taken.

    Raises:
        GibenchError: something is slower, broken or missing, or a file cannot be written.
    """
    import json

    from gibench.measure.runfolder.folder import write_atomically

    whole = json.dumps(found.content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    for path, written in ((markdown, found.markdown), (json_file, whole)):
        if path == Path("-"):
            typer.echo(written, nl=False)
        elif path is not None:
            write_atomically(path, written.encode())
    if not quiet and Path("-") not in (markdown, json_file):
        found.show()
    if found.error is not None:
        raise found.error
