"""Writing a file whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

UNFINISHED = ".tmp"
"""How the name of a file that is being written ends."""


def write_whole(path: Path, content: bytes | memoryview) -> None:
    """Write ``path`` so that readers see the old file or the new one, never half of one.

    The content goes to ``.<name>.<random>.tmp`` beside it, is flushed to the disk and renamed.

    Raises:
        OSError: the disk refuses; nothing is left behind.
    """
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=UNFINISHED, dir=path.parent)
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.chmod(0o644)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def remove_unfinished(path: Path) -> None:
    """Remove what killed writers of ``path``, and of ``path`` with any suffix, have left.

    Nobody may be writing them.
    """
    for leftover in path.parent.glob(f".{path.name}.*{UNFINISHED}"):
        leftover.unlink(missing_ok=True)
