"""What a history keeps of a run: three tables, made from its folder or a file of JSON."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gibench.errors import BadInput
from gibench.measure.compare.timings import configuration_label
from gibench.measure.runfolder.stored_run import StoredRun, read_run

if TYPE_CHECKING:
    import pandas as pd

_MEND = "give a run's folder, what 'gibench ab --json' or pytest-benchmark wrote, or a history"
FRAME, GI = "(frame)", "(gi)"
"""Beside the passes: a frame's wall time, and the time of its passes of stage gi."""

RUN_COLUMNS = {
    "run": "VARCHAR",
    "started_utc": "TIMESTAMP",
    "kind": "VARCHAR",
    "machine": "VARCHAR",
    "machine_text": "VARCHAR",
    "runtime": "VARCHAR",
    "revision": "VARCHAR",
    "dirty": "BOOLEAN",
    "environment": "VARCHAR",
    "folder": "VARCHAR",
    "read_gb_per_s": "DOUBLE",
    "fma_gflop_per_s": "DOUBLE",
}
CONFIGURATION_COLUMNS = {
    "run": "VARCHAR",
    "configuration": "INTEGER",
    "series": "VARCHAR",
    "label": "VARCHAR",
    "unit": "VARCHAR",
    "technique": "VARCHAR",
    "variant": "VARCHAR",
    "scene": "VARCHAR",
    "profile": "VARCHAR",
    "workgroup_size": "INTEGER",
    "settings": "VARCHAR",
    "memory_bytes": "BIGINT",
    "status": "VARCHAR",
}
SAMPLE_COLUMNS = {
    "run": "VARCHAR",
    "configuration": "INTEGER",
    "pass": "VARCHAR",
    "frame": "INTEGER",
    "value": "DOUBLE",
}
TABLES = {
    "runs": RUN_COLUMNS,
    "configurations": CONFIGURATION_COLUMNS,
    "samples": SAMPLE_COLUMNS,
}
"""The tables of a history, each with its columns' types."""


@dataclass(frozen=True)
class Entry:
    """A run as a history keeps it.

    Attributes:
        run: its name, made of its content: the same run has the same name wherever it is added.
        tables: by name, with the columns of :data:`TABLES`.
    """

    run: str
    tables: Mapping[str, pd.DataFrame]


def read_entry(path: Path) -> Entry:
    """The run in the folder ``path``, or the file of pytest-benchmark.

    Raises:
        BadInput: it is neither, is damaged or was never finished.
    """
    if not path.is_file():
        return _of_run(read_run(path))
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        kind = content.get("kind", "")
    except (OSError, ValueError, AttributeError) as error:
        raise BadInput("this file is no JSON of a benchmark", where=path, mend=_MEND) from error
    try:
        return _of_ab(path, content) if kind == "ab" else _of_benchmark(path, content)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInput("this JSON file is of no benchmark", where=path, mend=_MEND) from error


def _of_run(run: StoredRun) -> Entry:
    import pandas as pd

    record = run.record
    name = _digest({"record": record, "samples": _content_hash(run.samples)})
    environment, device = record["environment"], record["device"]
    versions = record.get("versions") or {}
    git = versions.get("git") or {}
    roofs = record["roofs"].get("end") or record["roofs"]["start"]
    row = {
        "run": name,
        "started_utc": record.get("started_utc"),
        "kind": "run",
        **machine_of(environment),
        "runtime": f"{device.get('platform')} {device.get('driver')} on {device.get('name')}",
        "revision": git.get("revision") or f"gibench {versions.get('gibench', 'unknown')}",
        "dirty": bool(git.get("dirty")),
        "environment": _environment(environment, versions),
        "folder": str(run.path.resolve()),
        "read_gb_per_s": roofs.get("read_gb_per_s"),
        "fma_gflop_per_s": roofs.get("fma_gflop_per_s"),
    }
    configurations = [_configuration(name, entry, record) for entry in record["configurations"]]
    return _entry(name, pd.DataFrame([row]), pd.DataFrame(configurations), _samples(name, run))


def _entry(
    name: str, runs: pd.DataFrame, configurations: pd.DataFrame, samples: pd.DataFrame
) -> Entry:
    tables = {"runs": runs, "configurations": configurations, "samples": samples}
    return Entry(name, {key: _typed(table, TABLES[key]) for key, table in tables.items()})


def _environment(environment: Mapping[str, Any], versions: Mapping[str, Any]) -> str:
    """What may change between runs of one machine, as JSON."""
    facts = {
        key: environment.get(key) for key in ("os", "kernel", "python", "governor", "variables")
    }
    of = {name: version for name, version in versions.items() if name != "git"}
    return json.dumps(facts | {"versions": of}, sort_keys=True)


def machine_of(environment: Mapping[str, Any]) -> dict[str, str]:
    """What makes two runs runs of one machine; its memory to the nearest GiB."""
    threads = environment.get("usable_threads") or environment.get("threads")
    facts = {
        "cpu": environment.get("cpu"),
        "threads": threads,
        "memory_gib": round((environment.get("memory_bytes") or 0) / 2**30),
        "machine": environment.get("machine"),
    }
    text = f"{facts['cpu']}, {threads} threads, {facts['memory_gib']} GiB"
    return {"machine": _digest(facts), "machine_text": text}


def _configuration(
    name: str, entry: Mapping[str, Any], record: Mapping[str, Any]
) -> dict[str, Any]:
    label = configuration_label(entry, record)
    scenes = {one["name"]: one.get("content_hash") for one in record.get("scenes", ())}
    profiles = {one["name"]: one.get("content_hash") for one in record["profiles"]}
    flight, motion = record.get("flight") or {}, record.get("motion") or {}
    identity = {
        "label": label,
        "settings": entry.get("settings"),
        "image": record.get("image"),
        "seed": record["seed"],
        "camera": entry.get("camera"),
        "flight": None if flight.get("path", "rest") == "rest" else flight,
        "motion": None if motion.get("path", "rest") == "rest" else motion,
        "cold": bool(record.get("cold")),
        "scene": scenes.get(entry["scene"]),
        "profile": profiles.get(entry["profile"]),
    }
    return {
        "run": name,
        "configuration": entry["configuration"],
        "series": _digest(identity),
        "label": label,
        "unit": "ms",
        **{key: entry.get(key) for key in ("technique", "variant", "scene", "profile", "status")},
        "workgroup_size": entry.get("workgroup_size"),
        "settings": json.dumps(entry.get("settings") or {}, sort_keys=True),
        "memory_bytes": entry.get("memory_bytes"),
    }


def _samples(name: str, run: StoredRun) -> pd.DataFrame:
    """Passes, whole frames, and GI where the run says which pass is of that stage."""
    import pandas as pd

    columns = ["configuration", "pass", "frame", "time_ms"]
    samples = run.samples
    by_frame = samples.groupby(["configuration", "frame"], as_index=False)
    walls = by_frame[["frame_wall_ms"]].first().rename(columns={"frame_wall_ms": "time_ms"})
    stages = {
        (entry["configuration"], item["pass"]): item.get("stage") or ""
        for entry in run.record["configurations"]
        for item in entry["passes"]
    }
    keys = zip(samples["configuration"], samples["pass"], strict=True)
    gi = samples[[stages.get(key) == "gi" for key in keys]]
    sums = gi.groupby(["configuration", "frame"], as_index=False)["time_ms"].sum()
    parts = [samples[columns], walls.assign(**{"pass": FRAME}), sums.assign(**{"pass": GI})]
    joined: pd.DataFrame = pd.concat([part[columns] for part in parts if len(part)])
    return joined.rename(columns={"time_ms": "value"}).assign(run=name)


def _of_ab(file: Path, content: Mapping[str, Any]) -> Entry:
    """Times over those of a baseline, timed in turns: what a shared machine does cancels out. One
    series for each baseline and job.
    """
    import pandas as pd

    measured = content["measured"]
    environment, versions = measured["environment"], measured["versions"]
    git = versions.get("git") or {}
    name = _digest(content)
    baseline = content["old"]
    label = f"{content['title'].removeprefix('gibench ab: ')} against {baseline['name']}"
    run = {
        "run": name,
        "started_utc": measured["started_utc"],
        "kind": "ab",
        **machine_of(environment),
        "runtime": measured["device"],
        "revision": git.get("revision") or f"kernels {content['new']['kernels'][:12]}",
        "dirty": bool(git.get("dirty")),
        "environment": _environment(environment, versions),
        "folder": str(file.resolve()),
    }
    configuration = {"run": name, "configuration": 1, "label": label, "unit": "ratio"}
    configuration |= {"series": _digest([content["title"], baseline["kernels"]]), "status": "ok"}
    samples = [
        {"run": name, "configuration": 1, "pass": FRAME if row == "frame" else row}
        | {"frame": pair, "value": math.exp(ratio)}
        for row, ratios in content["log_ratios"].items()
        for pair, ratio in enumerate(ratios)
    ]
    return _entry(name, pd.DataFrame([run]), pd.DataFrame([configuration]), pd.DataFrame(samples))


def _of_benchmark(file: Path, content: Mapping[str, Any]) -> Entry:
    import pandas as pd

    machine, benchmarks = content["machine_info"], content["benchmarks"]
    commit, cpu = content.get("commit_info") or {}, machine.get("cpu") or {}
    rows = [_benchmark(number, one) for number, one in enumerate(benchmarks, 1)]
    if not rows:
        raise BadInput("this file of pytest-benchmark holds no benchmark", where=file)
    name = _digest(content)
    facts = {"cpu": cpu.get("brand_raw"), "threads": cpu.get("count"), "of": machine.get("machine")}
    run = {
        "run": name,
        "started_utc": pd.Timestamp(str(content["datetime"])).tz_convert(None),
        "kind": "pytest-benchmark",
        "machine": _digest(facts),
        "machine_text": f"{facts['cpu']}, {facts['threads']} threads",
        "runtime": f"pytest-benchmark {content.get('version', '')}".strip(),
        "revision": commit.get("id") or "unknown revision",
        "dirty": bool(commit.get("dirty")),
        "environment": json.dumps({"python": machine.get("python_version")}, sort_keys=True),
        "folder": str(file.resolve()),
        "read_gb_per_s": None,
        "fma_gflop_per_s": None,
    }
    configurations = [
        {"run": name, "series": _digest(label), "label": label, "configuration": number}
        | {"unit": "ms", "status": "ok", "technique": "", "settings": "{}"}
        for number, label, _ in rows
    ]
    samples = [
        {"run": name, "configuration": number, "pass": FRAME, "frame": k, "value": 1e3 * seconds}
        for number, _, times in rows
        for k, seconds in enumerate(times)
    ]
    return _entry(name, pd.DataFrame([run]), pd.DataFrame(configurations), pd.DataFrame(samples))


def _benchmark(number: int, one: Mapping[str, Any]) -> tuple[int, str, list[float]]:
    """A benchmark's number, name and times, s: of every round where kept, else the median."""
    times = [float(t) for t in one["stats"].get("data") or [one["stats"]["median"]]]
    return number, str(one["fullname"]), times


def _typed(table: pd.DataFrame, columns: Mapping[str, str]) -> pd.DataFrame:
    import pandas as pd

    table = table.reindex(columns=list(columns))
    if "started_utc" in columns:
        table["started_utc"] = pd.to_datetime(table["started_utc"])
    return table


def _digest(content: Any) -> str:
    text = json.dumps(content, sort_keys=True, ensure_ascii=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _content_hash(samples: pd.DataFrame) -> str:
    return hashlib.sha256(samples.to_csv(index=False).encode()).hexdigest()
