"""The page of many machines: which technique wins where, and time against their roofs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import pandas as pd

from gibench.history.submission import Submission
from gibench.history.template import filled
from gibench.report.plots import technique_colors
from gibench.report.tables import run_roofs

_SAME = ("scene", "profile", "image")
"""Only times of the same scene, limits and image stand in one comparison."""


def gallery_table(submissions: Sequence[Submission]) -> pd.DataFrame:
    """A row per configuration that ran: run (its file), machine, scene, profile, image, technique,
    variant, gi_ms, frame_ms, memory_mib, bandwidth (GB/s) and flop rate (GFLOP/s) of the machine,
    conform.
    """
    rows = []
    for one in submissions:
        record, roofs = one.run.record, run_roofs(one.run.record)
        image = record.get("image") or {}
        threads = record["environment"].get("usable_threads")
        shared = {
            "run": one.name,
            "machine": f"{record['environment'].get('cpu')}, {threads} threads, "
            f"{record['device'].get('platform')}",
            "image": f"{image.get('width', '?')} x {image.get('height', '?')}",
            "gb_per_s": roofs.gb_per_s,
            "gflop_per_s": roofs.fma_gflop_per_s,
            "conform": _conform(one),
        }
        for row in one.run.frames.to_dict("records"):
            if row["status"] != "ok":
                continue
            kept = {key: row[key] for key in ("scene", "profile", "technique", "variant")}
            times = {"gi_ms": row["gi_ms"], "frame_ms": row["median_ms"]}
            rows.append(shared | kept | times | {"memory_mib": row["memory_bytes"] / 2**20})
    return pd.DataFrame(rows)


def winners(table: pd.DataFrame) -> pd.DataFrame:
    """Of each run, scene, profile and image the technique of the least GI time, and by how much it
    leads the next. Times of two runs never compete, nor do techniques without GI passes.
    """
    rows = []
    competing = table[table["gi_ms"] > 0]
    for keys, group in competing.groupby(["run", "machine", *_SAME], sort=False):
        best = group.groupby("technique")["gi_ms"].min().sort_values()
        lead = best.iloc[1] / best.iloc[0] if len(best) > 1 else float("nan")
        found = dict(zip(("run", "machine", *_SAME), keys, strict=True))
        rows.append(found | {"technique": best.index[0], "gi_ms": best.iloc[0], "lead": lead})
    return pd.DataFrame(rows, columns=["run", "machine", *_SAME, "technique", "gi_ms", "lead"])


def gallery(submissions: Sequence[Submission]) -> str:
    """The page, self-contained."""
    table = gallery_table(submissions)
    won = winners(table)
    data = {
        "colors": technique_colors(table["technique"]) if len(table) else {},
        "rows": _plain(table),
        "winners": _plain(won),
    }
    return filled("gallery", data)


def _conform(one: Submission) -> str:
    if one.conform is None:
        return ""
    wrong = one.conform.get("wrong")
    return "checked" if not wrong else f"{wrong} wrong" if isinstance(wrong, int) else "wrong"


def _plain(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [dict(row) for row in json.loads(table.to_json(orient="records", double_precision=6))]
