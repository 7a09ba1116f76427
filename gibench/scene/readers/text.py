"""Text files as programs of three decades have written them."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from pathlib import Path

from gibench.errors import BadInput
from gibench.scene.files import read_bytes


def read_text(path: Path, kind: str) -> str:
    """The text of an OBJ or MTL file: UTF-8 with or without a mark, UTF-16 with one, or Latin-1.

    Line ends of any system become ``\\n``.

    Raises:
        BadInput: it cannot be read, or is binary and no ``kind``.
    """
    data = read_bytes(path)
    text = None
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = _decoded(data, "utf-16")
    if text is None:
        if b"\0" in data[:65536]:
            raise BadInput(f"binary data, not {kind}", where=path)
        text = _decoded(data, "utf-8-sig")
    if text is None:
        text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _decoded(data: bytes, encoding: str) -> str | None:
    try:
        return data.decode(encoding)
    except UnicodeDecodeError:
        return None


def statements(text: str) -> Iterator[tuple[int, str]]:
    """Line number and text of every statement; comments and empty lines are left out.

    A backslash at the end of a line, or before its last blanks, continues it, but not a comment.
    ``#`` begins a comment at the start of a line; further on it may belong to a name, see
    ``without_comment``.
    """
    begun, first = "", 0
    for number, line in enumerate(text.split("\n"), 1):
        first = first or number
        if not begun and line.lstrip().startswith("#"):
            first = 0
            continue
        if line.endswith(("\\", " ", "\t")) and (ended := line.rstrip()).endswith("\\"):
            begun += ended[:-1] + " "
            continue
        whole = (begun + line).strip()
        if whole:
            yield first, whole
        begun, first = "", 0
    if begun.strip():
        yield first, begun.strip()


def argument(statement: str) -> str:
    """What follows the keyword."""
    parts = statement.split(None, 1)
    return parts[1].strip() if len(parts) > 1 else ""


def without_comment(text: str) -> str:
    """The text before a ``#`` that has blanks, or the end, on both sides: `wall # brown` is
    `wall`, and `Material #1` and `wall#3` are names as they stand.
    """
    return re.split(r"(?:^|\s)#(?:\s|$)", text, maxsplit=1)[0].strip()
