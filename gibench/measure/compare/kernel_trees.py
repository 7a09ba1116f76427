"""Kernel trees to compare: a folder, or ``kernels_cl`` as it was at a git revision."""

from __future__ import annotations

import io
import subprocess
import tarfile
from dataclasses import dataclass
from pathlib import Path

from gibench.device.source import tree_hash
from gibench.errors import BadInput

FOLDER = "kernels_cl"


@dataclass(frozen=True)
class KernelTree:
    """A kernel tree on the disk.

    Attributes:
        name: as the user named it; a folder by its last part.
        root: the folder.
        content_hash: of all its sources.
    """

    name: str
    root: Path
    content_hash: str


def kernel_tree(name: str, beneath: Path) -> KernelTree:
    """The tree called ``name``.

    Args:
        name: a folder (a kernel tree, or a checkout that holds one) or a git revision of the
            repository of the working folder.
        beneath: where a revision's tree is unpacked.

    Raises:
        BadInput: it is neither, or holds no kernels.
    """
    path = Path(name)
    if path.is_dir():
        root = path / FOLDER if (path / FOLDER).is_dir() else path
        shown = path.resolve().name
    else:
        root, shown = _unpack(name, beneath), name
    if not any(root.rglob("*.cl")):
        raise BadInput("no OpenCL kernels (*.cl) there", where=name)
    return KernelTree(shown, root.resolve(), tree_hash(root))


def _unpack(revision: str, beneath: Path) -> Path:
    mend = "give a folder with kernels, or a git revision from inside a checkout of gibench"
    if revision.startswith("-"):
        raise BadInput(f"'{revision}' is neither a folder nor a git revision", mend=mend)
    try:
        top = _git("rev-parse", "--show-toplevel").decode().strip()
        commit = _git("rev-parse", "--verify", "--quiet", f"{revision}^{{commit}}").decode().strip()
        archive = _git("-C", top, "archive", "--format=tar", commit, FOLDER)
    except (OSError, subprocess.CalledProcessError) as error:
        raise BadInput(
            f"'{revision}' is neither a folder nor a git revision that has {FOLDER}", mend=mend
        ) from error
    root = beneath / commit
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        if hasattr(tarfile, "data_filter"):  # not in Python 3.11.0 to 3.11.3
            tar.extractall(root, filter="data")
        else:
            tar.extractall(root)  # git's own archive of the user's repository
    return root / FOLDER


def _git(*arguments: str) -> bytes:
    return subprocess.run(["git", *arguments], capture_output=True, check=True).stdout
