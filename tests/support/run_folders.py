"""Run folders written by hand, for the commands that read them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gibench.measure.runfolder.folder import sample_columns
from gibench.measure.statistics.summary import Roofs

ROOFS = Roofs(20.0, 15.0, 200.0, 2.0, 10.0)
WORK = {"flops": 4e8, "bytes_read": 3e7, "bytes_written": 1e7, "rays": 0.0, "atomics": 0.0}
KEYS = {
    "technique": "srp",
    "variant": "tuned",
    "layout": "wide",
    "scene": "box",
    "profile": "iphone7",
    "workgroup_size": 256,
    "sh_order": 2,
}


def entry(number: int, passes: list[str], **changes: Any) -> dict[str, Any]:
    """A configuration of run.json that ran."""
    base = {
        "configuration": number,
        **KEYS,
        "surfels": None,
        "probes": 27,
        "receivers": 1000,
        "counts": {"probes": 27, "receivers": 1000},
        "receivers_asked": 1000,
        "frames": 3,
        "warmup": 1,
        "camera": "front",
        "memory_bytes": 1 << 20,
        "memory_budget_bytes": 1 << 30,
        "status": "ok",
        "reason": "",
        "notes": [],
        "settings": {"sh_order": 2},
        "passes": [{"pass": name, **WORK, "status": "ok", "reason": ""} for name in passes],
    }
    return base | changes


def record(*entries: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """A run.json."""
    base = {
        "schema_version": 1,
        "finished": True,
        "interrupted": False,
        "arguments": {"save_images": False},
        "started_utc": "2026-01-01 00:00:00",
        "seed": 0,
        "image": {"width": 1334, "height": 750},
        "versions": {"gibench": "0.1.0"},
        "environment": {
            "cpu": "A CPU",
            "usable_threads": 2,
            "memory_bytes": 8 << 30,
            "os": "An OS",
            "variables": {},
        },
        "device": {"name": "cpu", "platform": "PoCL", "driver": "3.0"},
        "profiles": [{"name": "iphone7", "title": "Apple iPhone 7", "content_hash": "cd" * 32}],
        "roofs": {"start": asdict(ROOFS), "end": asdict(ROOFS)},
        "scenes": [{"name": "box", "triangles": 12, "content_hash": "ab" * 32, "warnings": []}],
        "configurations": list(entries),
    }
    return base | changes


def write_run(
    folder: Path, content: dict[str, Any], times: Mapping[int, Mapping[str, np.ndarray]]
) -> Path:
    """Write a run whose samples are ``times`` (ms, by configuration and pass, in frame order)."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = [",".join(sample_columns(("sh_order",), ("probes",)))]
    for one in content["configurations"]:
        passes = times.get(one["configuration"], {})
        if not passes:
            continue
        walls = sum(passes.values()) + 0.5
        one["frames"] = len(walls)
        for frame, wall in enumerate(walls):
            for name, values in passes.items():
                keys = ",".join(str("" if one[key] is None else one[key]) for key in KEYS)
                lines.append(
                    f"{keys},{name},{frame},{values[frame]:.6f},27,1000,{wall:.6f},"
                    f"{one['configuration']}"
                )
    (folder / "samples.csv").write_text("\n".join(lines) + "\n")
    (folder / "run.json").write_text(json.dumps(content))
    return folder
