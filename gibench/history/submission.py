"""A run in one file for other people: nothing is sent anywhere, and nothing personal is in it."""

from __future__ import annotations

import getpass
import io
import json
import platform
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gibench.errors import BadInput, GibenchError
from gibench.measure.machine.environment import without_paths
from gibench.measure.runfolder.folder import RECORD, SAMPLES
from gibench.measure.runfolder.stored_run import StoredRun, read_run
from gibench.report.loaded import LoadedRun, load_run

CONFORM = "conform.json"
SUFFIX = ".gibench"
_ASKED = frozenset(
    (
        *("device_profile", "scene", "technique", "variant", "frames", "resolution", "warmup"),
        *("cold", "seed", "camera_path", "motion", "settings"),
    )
)
"""Arguments that say what was measured; others say where files lay."""
_LEAST_NAME = 3
"""Shorter names of users or hosts are no evidence: they stand in ordinary words."""
_MOST_BYTES = 256 << 20


@dataclass(frozen=True)
class Submission:
    """A run that somebody shared.

    Attributes:
        name: of its file.
        run: as its folder would give it; its folder is gone.
        conform: the record of 'gibench conform' of its device, None where none was packed.
    """

    name: str
    run: LoadedRun
    conform: dict[str, Any] | None


def packed(run: StoredRun, conform: Path | None = None) -> bytes:
    """The file: a ZIP of the record, the samples, and the conform record if there is one.

    Paths are cut to their last part; arguments that only say where files lay are left out.

    Args:
        run: what to pack.
        conform: record of 'gibench conform --json'; by default ``conform.json`` beside the run's.

    Raises:
        BadInput: the conform record cannot be read.
        GibenchError: the user's or the host's name is still in it.
    """
    record = _cleaned(run.record)
    record["arguments"] = {
        key: value for key, value in record["arguments"].items() if key in _ASKED
    }
    contents = {RECORD: json.dumps(record, indent=1, ensure_ascii=False)}
    contents[SAMPLES] = run.samples.to_csv(index=False, lineterminator="\n")
    file = conform or run.path / CONFORM
    if conform is not None or file.exists():
        try:
            checked = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise BadInput("no record of 'gibench conform' can be read", where=file) from error
        contents[CONFORM] = json.dumps(_cleaned(checked), indent=1, ensure_ascii=False)
    for name, text in contents.items():
        _refuse_personal(name, text)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in contents.items():
            # A fixed date: the same run gives the same bytes.
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), text)
    return buffer.getvalue()


def read_submission(path: Path) -> Submission:
    """What :func:`packed` made.

    Raises:
        BadInput: it is nothing of the kind, or damaged.
    """
    mend = "give a file that 'gibench submit' wrote"
    try:
        with zipfile.ZipFile(path) as archive:
            known = [
                one for one in archive.infolist() if one.filename in (RECORD, SAMPLES, CONFORM)
            ]
            if sum(one.file_size for one in known) > _MOST_BYTES:
                raise BadInput("it holds more than a run would", where=path, mend=mend)
            contents = {one.filename: archive.read(one) for one in known}
    except (OSError, zipfile.BadZipFile, EOFError) as error:
        raise BadInput("it cannot be read", where=path, mend=mend) from error
    if RECORD not in contents or SAMPLES not in contents:
        raise BadInput("it holds no run", where=path, mend=mend)
    with tempfile.TemporaryDirectory() as folder:
        for name, content in contents.items():
            (Path(folder) / name).write_bytes(content)
        try:
            run = load_run(folder)
            text = contents.get(CONFORM)
            conform = None if text is None else dict(json.loads(text))
        except (BadInput, ValueError, KeyError, TypeError) as error:
            reason = error.what if isinstance(error, BadInput) else "its record is damaged"
            raise BadInput(reason, where=path, mend=mend) from error
    return Submission(path.name.removesuffix(SUFFIX), run, conform)


def pack_folder(folder: Path, conform: Path | None = None) -> bytes:
    """:func:`packed` of the run in ``folder``.

    Raises:
        BadInput: it is no run.
    """
    return packed(read_run(folder), conform)


def _cleaned(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _cleaned(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_cleaned(item) for item in value]
    return without_paths(value) if isinstance(value, str) else value


def _refuse_personal(name: str, text: str) -> None:
    """Never write a file that names the user, the host or the home folder."""
    own = {"the user's name": getpass.getuser(), "the host's name": platform.node()}
    own["the home folder"] = str(Path.home())
    for what, word in own.items():
        if len(word) >= _LEAST_NAME and word not in ("root", "localhost", "/root") and word in text:
            raise GibenchError(
                f"{what} stands in its {name}", mend="nothing was written; take it out of the run"
            )
