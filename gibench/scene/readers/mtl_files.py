"""The files that ``mtllib`` names."""

from __future__ import annotations

import re
from pathlib import Path

from gibench.scene.files import find_near
from gibench.scene.readers.text import without_comment


def library_files(folder: Path, text: str) -> tuple[list[Path], list[str]]:
    """The files that ``mtllib`` names, and the names of those that are missing.

    Names are separated by blanks and may hold them: the longest that is a file is taken.
    """
    short = without_comment(text)
    for whole in (text, short):
        if file := find_near((folder,), whole.strip('"')):
            return [file], []
    words = re.findall(r'"[^"]*"|\S+', short)
    files, unknown = [], []
    while words:
        for count in range(len(words), 0, -1):
            name = " ".join(words[:count]).strip('"')
            if file := find_near((folder,), name):
                files.append(file)
                break
        else:
            count = 1
            unknown.append(words[0].strip('"'))
        words = words[count:]
    return (files, unknown) if files else ([], [short or text])
