"""Shards joined to the run, or the study, that they are shares of."""

from __future__ import annotations

import csv
import io
import logging
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gibench.errors import BadInput
from gibench.history.entries import machine_of
from gibench.measure.runfolder.folder import SAMPLES, RunFolder
from gibench.measure.runfolder.stored_run import read_any_record, read_record

_LOG = logging.getLogger(__name__)
_FOLDERS = ("images", "irradiance")
_JOINED = ("errors.csv", "projected.csv")
_STEADY_ROOFS = 0.1
"""Roofs of shards that lie further apart are told: their times may not be those of one machine."""


@dataclass(frozen=True)
class _Part:
    """One shard: its folder, its record, and what the record says of the share."""

    path: Path
    record: dict[str, Any]
    shard: dict[str, Any]

    @property
    def name(self) -> str:
        return f"{self.shard['index']}/{self.shard['of']}"


@dataclass(frozen=True)
class Merged:
    """What was joined.

    Attributes:
        folder: that holds it.
        record: the content of its ``run.json``.
        shards: how many.
        total: configurations or points.
        is_run: whether it is a run, whose tables can be written from its samples; a study's report
            is written by its own command.
    """

    folder: RunFolder
    record: dict[str, Any]
    shards: int
    total: int
    is_run: bool


def merge_shards(paths: Sequence[Path], out: Path) -> Merged:
    """Join the shards in ``paths`` into the folder ``out``.

    Raises:
        BadInput: one is no shard, is not finished, is there twice, is missing, or does not belong
            to the others: of another machine, device, revision, seed or question.
        GibenchError: the folder cannot be written.
    """
    parts = _in_order([_part(path) for path in paths])
    first = parts[0]
    for other in parts[1:]:
        _refuse_strangers(first, other)
    arguments = {k: v for k, v in first.record["arguments"].items() if k != "shard"}
    is_run = "configurations" in first.record
    join = _joined_run if is_run else _joined_study
    texts, record = join(parts)
    record = {**record, "arguments": arguments, "shards": [_told(part) for part in parts]}
    _tell_doubts(parts)
    folder = RunFolder.create(out, arguments)
    for name, text in texts.items():
        folder.write_text(name, text)
    for part in parts:
        for name in _FOLDERS:
            _copy_new(part.path / name, out / name)
    folder.write_record(record)
    return Merged(folder, record, len(parts), first.shard["total"], is_run)


def _part(path: Path) -> _Part:
    record = read_any_record(path)
    shard = (record.get("arguments") or {}).get("shard")
    if not isinstance(shard, dict) or not {"index", "of", "total", "whole"} <= set(shard):
        raise BadInput(
            "it is no shard", where=path, mend="give folders that a command with --shard left"
        )
    if "configurations" in record:
        record = read_record(path)
        if not record.get("finished") or record.get("interrupted"):
            name = f"{shard['index']}/{shard['of']}"
            raise BadInput(
                f"shard {name} was not finished", where=path, mend="run it again, then merge"
            )
    return _Part(path, record, shard)


def _in_order(parts: Sequence[_Part]) -> list[_Part]:
    """The shards in order, each there once.

    Raises:
        BadInput: they are of different divisions, one is there twice, or some are missing.
    """
    if not parts:
        raise BadInput("there is nothing to merge", mend="give the shards' folders")
    by_index: dict[int, _Part] = {}
    first = parts[0]
    for part in parts:
        if part.shard["of"] != first.shard["of"]:
            raise BadInput(
                f"it is shard {part.name}, {first.path} is {first.name}", where=part.path
            )
        if (other := by_index.setdefault(part.shard["index"], part)) is not part:
            raise BadInput(f"shard {part.name} is there twice: {other.path} too", where=part.path)
    missing = sorted(set(range(1, first.shard["of"] + 1)) - set(by_index))
    if missing:
        named = ", ".join(f"{index}/{first.shard['of']}" for index in missing)
        what = f"shard {named} is" if len(missing) == 1 else f"shards {named} are"
        raise BadInput(f"{what} missing", mend="run what is missing, or give its folder too")
    return [by_index[index] for index in sorted(by_index)]


def _refuse_strangers(one: _Part, other: _Part) -> None:
    """Refuse shards that are not of one question, machine and code.

    Raises:
        BadInput: naming what differs.
    """
    facts: tuple[tuple[str, Callable[[Mapping[str, Any]], Any]], ...] = (
        ("seed", lambda record: record["seed"]),
        ("machine", lambda record: machine_of(record["environment"])["machine_text"]),
        ("OpenCL device", lambda record: _runtime(record["device"])),
        ("revision", _revision),
    )
    for name, fact in facts:
        mine, theirs = fact(one.record), fact(other.record)
        if mine != theirs:
            raise BadInput(
                f"the {name} of shard {other.name} is {theirs}, that of shard {one.name} {mine}",
                where=other.path,
                mend="merge what was measured alike",
            )
    asked = {k: v for k, v in one.record["arguments"].items() if k != "shard"}
    also = {k: v for k, v in other.record["arguments"].items() if k != "shard"}
    for name in sorted({*asked, *also}):
        if asked.get(name) != also.get(name):
            raise BadInput(
                f"shard {other.name} was asked for {name} {also.get(name)}, shard {one.name} for "
                f"{asked.get(name)}",
                where=other.path,
            )
    if any(one.shard[key] != other.shard[key] for key in ("total", "whole")):
        raise BadInput(
            f"shard {other.name} is a share of other things than shard {one.name}: what was left "
            "out, or baked already, was not the same",
            where=other.path,
            mend="name the techniques with --technique, and run the shards again",
        )
    scenes = {one["name"]: one.get("content_hash") for one in one.record.get("scenes", ())}
    for scene in other.record.get("scenes", ()):
        if scenes.setdefault(scene["name"], scene["content_hash"]) != scene["content_hash"]:
            raise BadInput(
                f"the scene {scene['name']} of shard {other.name} is another", where=other.path
            )


def _runtime(device: Mapping[str, Any]) -> str:
    return f"{device.get('platform')} {device.get('driver')} on {device.get('name')}"


def _revision(record: Mapping[str, Any]) -> str:
    versions = record.get("versions") or {}
    git = versions.get("git") or {}
    return str(git.get("revision") or f"gibench {versions.get('gibench')}")


def _told(part: _Part) -> dict[str, Any]:
    """What is kept of a shard beside its results."""
    kept = ("started_utc", "finished_utc", "roofs", "environment")
    return {"shard": part.name, **{name: part.record.get(name) for name in kept}}


def _tell_doubts(parts: Sequence[_Part]) -> None:
    """Warn where shards may differ though their records do not say so."""
    if any(((part.record.get("versions") or {}).get("git") or {}).get("dirty") for part in parts):
        _LOG.warning("some shard ran from a checkout with changes: were they the same?")
    for name in ("read_gb_per_s", "fma_gflop_per_s"):
        found = [
            part.record["roofs"]["start"].get(name) for part in parts if part.record.get("roofs")
        ]
        known = [float(value) for value in found if value]
        if known and max(known) > (1 + _STEADY_ROOFS) * min(known):
            _LOG.warning(
                "the machines of the shards were not equally fast: %s from %.1f to %.1f",
                name,
                min(known),
                max(known),
            )


def _joined_run(parts: Sequence[_Part]) -> tuple[dict[str, str], dict[str, Any]]:
    texts = {SAMPLES: _stacked([part.path / SAMPLES for part in parts])}
    for name in _JOINED:
        files = [part.path / name for part in parts if (part.path / name).is_file()]
        if files:
            texts[name] = _stacked(files)
    first, last = parts[0].record, parts[-1].record
    entries: list[dict[str, Any]] = []
    groups = 0
    for part in parts:
        mine = part.record["configurations"]
        entries += [{**one, "group": one.get("group", 1) + groups} for one in mine]
        groups = max((one["group"] for one in entries), default=groups)
    numbers = [entry["configuration"] for entry in entries]
    if numbers != list(range(1, parts[0].shard["total"] + 1)):
        raise BadInput("the shards' configurations are not those that were divided")
    started = [str(part.record["started_utc"]) for part in parts]
    ended = [str(part.record.get("finished_utc") or "") for part in parts]
    again = all(part.record["roofs"].get("measured_again") for part in parts)
    return texts, {
        **first,
        "started_utc": min(started),
        "finished_utc": max(ended),
        "roofs": {**first["roofs"], "end": last["roofs"]["end"], "measured_again": again},
        "scenes": _unique(parts, "scenes"),
        "profiles": _unique(parts, "profiles"),
        "configurations": entries,
    }


def _unique(parts: Sequence[_Part], name: str) -> list[Any]:
    found = {one["name"]: one for part in parts for one in part.record.get(name, ())}
    return list(found.values())


def _joined_study(parts: Sequence[_Part]) -> tuple[dict[str, str], dict[str, Any]]:
    texts = {}
    for name, keys in parts[0].shard["tables"].items():
        head: list[str] = []
        lines: list[list[str]] = []
        for part in parts:
            columns, mine = _own_rows(part, name, keys)
            if head and columns != head:
                raise BadInput("it has other columns than its shard 1", where=part.path / name)
            head = columns
            lines += mine
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([head, *lines])
        texts[name] = text.getvalue()
    return texts, parts[0].record


def _own_rows(part: _Part, name: str, keys: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """Head and rows of a shard's table, without those of points that it measured for its own only.

    Raises:
        BadInput: there is no such table, or a point of its own is missing.
    """
    file = part.path / name
    try:
        with file.open(newline="", encoding="utf-8") as stream:
            head, *lines = list(csv.reader(stream))
        places = [head.index(key) for key in keys]
    except (OSError, ValueError) as error:
        raise BadInput("it cannot be read", where=file, mend="run this shard again") from error
    by_key: dict[tuple[str, ...], list[list[str]]] = {}
    for line in lines:
        by_key.setdefault(tuple(line[place] for place in places), []).append(line)
    own = [tuple(key) for key in part.shard["own"]]
    missing = [key for key in own if key not in by_key]
    if missing and name == next(iter(part.shard["tables"])):
        what = ", ".join(f"{n} {v}" for n, v in zip(keys, missing[0], strict=True))
        raise BadInput(
            f"shard {part.name} was not finished: {len(missing)} of {len(own)} are missing, the "
            f"first {what}",
            where=file,
            mend="run it again, then merge",
        )
    return head, [line for key in own for line in by_key.get(key, [])]


def _stacked(files: Sequence[Path]) -> str:
    """Tables of one head below each other.

    Raises:
        BadInput: one cannot be read, or has another head.
    """
    head, bodies = "", []
    for file in files:
        try:
            first, _, body = file.read_text(encoding="utf-8").partition("\n")
        except (OSError, ValueError) as error:
            raise BadInput("it cannot be read", where=file, mend="run this shard again") from error
        if head and first != head:
            raise BadInput("it has other columns than its shard 1", where=file)
        head = first
        bodies.append(body)
    return head + "\n" + "".join(bodies)


def _copy_new(source: Path, target: Path) -> None:
    """Copy what is not there yet."""
    for file in sorted(source.rglob("*")) if source.is_dir() else ():
        to = target / file.relative_to(source)
        if file.is_file() and not to.exists():
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, to)
