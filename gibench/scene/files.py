"""Reading files, with every failure as one clear line."""

from __future__ import annotations

from pathlib import Path, PureWindowsPath

from gibench.errors import BadInput


def read_bytes(path: Path) -> bytes:
    """The content of ``path``.

    Raises:
        BadInput: it is missing, a folder, or cannot be read.
    """
    if path.is_dir():
        raise BadInput("is a folder, not a file", where=path)
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise BadInput("no such file", where=path) from error
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror or error})", where=path) from error
    except ValueError as error:  # a NUL in the name
        raise BadInput("not a file name", where=path) from error


def find_beside(folder: Path, name: str) -> Path | None:
    """The file called ``name`` in ``folder``; Windows separators and other case will do."""
    plain = name.strip().strip('"').replace("\\", "/")
    try:
        if not plain:
            return None
        if (folder / plain).is_file():
            return folder / plain
        current = folder
        for step in Path(plain).parts:
            if step in ("..", "."):
                current = current / step
                continue
            matches = [p for p in current.iterdir() if p.name.lower() == step.lower()]
            if not matches:
                return None
            current = matches[0]
        return current if current.is_file() else None
    except (OSError, ValueError):
        return None


def find_near(folders: tuple[Path, ...], name: str) -> Path | None:
    """The file called ``name`` in one of ``folders``, as a path from there, or by its last part
    alone: where people put files whose path was another machine's.
    """
    for wanted in (name, PureWindowsPath(name).name):
        for folder in folders:
            found = find_beside(folder, wanted)
            if found is not None:
                return found
    return None
