"""``gibench submit`` and ``gibench gallery``: results for other people, without a server."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gibench.commands import asked
from gibench.errors import BadInput
from gibench.history.gallery import gallery
from gibench.history.submission import SUFFIX, pack_folder, read_submission
from gibench.measure.runfolder.folder import write_atomically


def submit(
    run: str | Path, out: str | Path | None = None, conform: str | Path | None = None
) -> Path:
    """Pack a run into one file and send nothing; the file's path.

    Args:
        run: its folder.
        out: the file; by default the folder's name with ``.gibench`` beside it.
        conform: record of 'gibench conform --json', where it is not in the run's folder.

    Raises:
        BadInput: it is no run, or the conform record cannot be read.
        GibenchError: something personal is in it, or the file cannot be written.
    """
    folder = Path(run)
    target = Path(out) if out else folder.resolve().with_name(folder.resolve().name + SUFFIX)
    if target.is_dir():
        raise BadInput("this is a folder", where=target, mend="give a file with --out")
    content = pack_folder(folder, Path(conform) if conform else None)
    write_atomically(target, content)
    return target


def make_gallery(submissions: Sequence[str | Path], out: str | Path = "gallery.html") -> Path:
    """Write the page of many submissions; its path.

    Raises:
        BadInput: one of them is none.
        GibenchError: the page cannot be written.
    """
    paths = [Path(each) for each in dict.fromkeys(map(str, asked.several(submissions)))]
    target = Path(out)
    if target.is_dir():
        raise BadInput("this is a folder", where=target, mend="give a file with --out")
    write_atomically(target, gallery([read_submission(path) for path in paths]).encode())
    return target
