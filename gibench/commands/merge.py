"""``gibench merge``: shards joined to what they are shares of."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gibench.commands import asked
from gibench.commands.run_files import write_tables
from gibench.history.merge import Merged, merge_shards


def merge(runs: Sequence[str | Path], out: str | Path) -> Merged:
    """Join shards of ``run``, ``experiment`` or ``advise`` into the folder ``out``.

    A run's tables and report are written anew from its samples. The report of a study is written by
    its own command, which finds all measured there.

    Raises:
        BadInput: they do not belong together: naming which, and why.
        GibenchError: the folder cannot be written.
    """
    paths = [Path(each) for each in dict.fromkeys(map(str, asked.several(runs)))]
    merged = merge_shards(paths, Path(out))
    if merged.is_run:
        write_tables(merged.folder, merged.record)
    return merged
