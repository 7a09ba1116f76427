"""The table of ``gibench experiment defaults`` from parts measured at different times.

    python tests/support/defaults_table.py TABLE [PART ...] [--times RUN] --cache-dir DIR

TABLE is the folder that it stands in and is written to; a PART is a folder of the experiment, whose
rows replace those there. Remarks and verdicts are said anew by today's tests of geometry. RUN is a
folder of ``gibench run`` of the same scenes and techniques at 320x180 and 4,000 receivers, whose
median frames become the times.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import pandas as pd

from gibench.measure.plan.grid import grid
from gibench.profiles import load_profile
from gibench.study.experiments import defaults
from gibench.study.site import Site
from gibench.techniques.job import Shot
from gibench.techniques.registry import find_technique

KEYS = ["scene", "technique"]

PLACES = {"sponza": "/work/shared/scenes/sponza_crytek/sponza.obj"}


RECEIVERS = {"sponza": 16_000, "atrium": 8_000}


def remarked(scene: str, technique: str, caches: Path) -> list[str]:
    """What ``technique`` says of the scene before a run, as the experiment asks it; ``caches`` hold
    the probes that it places.
    """
    place = PLACES.get(scene, scene)
    (job,) = grid(
        [load_profile(defaults.EXPERIMENT.profiles[0])], [find_technique(technique)],
        scenes=(place,), receivers=(RECEIVERS.get(scene, 4000),),
        settings={technique: {}}, seed=0,
    )  # fmt: skip
    job = replace(job, shot=Shot(*defaults._IMAGE))
    return defaults.remarks_on(job, Site(caches).standing())


def main() -> None:
    """Join, say anew, write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("table", type=Path)
    parser.add_argument("parts", type=Path, nargs="*")
    parser.add_argument("--times", type=Path)
    parser.add_argument("--cache-dir", type=Path, required=True)
    asked = parser.parse_args()
    tables = [pd.read_csv(one / "defaults.csv") for one in (asked.table, *asked.parts)]
    for part in tables[1:]:
        part["time_ms"] = float("nan")  # measured beside others
    table = pd.concat(tables, ignore_index=True).drop_duplicates(KEYS, keep="last")
    if asked.times is not None:
        frames = pd.read_csv(asked.times / "frames.csv").set_index(KEYS)["median_ms"]
        keys = list(zip(table["scene"], table["technique"], strict=True))
        table["time_ms"] = [frames.get(key, float("nan")) for key in keys]
    order = [*defaults._SCENES, "sponza"]
    table["at"] = table["scene"].map(order.index)
    table = table.sort_values(["at", "technique"]).drop(columns="at")
    said = [
        remarked(*key, asked.cache_dir)
        for key in zip(table["scene"], table["technique"], strict=True)
    ]
    table["remarks"] = ["; ".join(told) for told in said]
    table["verdict"] = [
        defaults._verdict(float(bias), bool(told))
        for bias, told in zip(table["bias"], said, strict=True)
    ]
    columns = [*KEYS, *defaults.EXPERIMENT.columns, "status", "reason"]
    table = table.reindex(columns=columns)
    table.to_csv(asked.table / "defaults.csv", index=False, lineterminator="\n")
    held = set(zip(table["scene"], table["technique"], strict=True))
    missing = [
        f"`{technique}` on {scene}"
        for scene in order
        for technique in defaults._TECHNIQUES
        if (scene, technique) not in held
    ]
    shown = defaults._present(None, None, table)  # type: ignore[arg-type]
    lines = [
        f"# {defaults.EXPERIMENT.title}",
        "Source: nobody: a check of this suite. 4,000 receivers (8,000 in the atrium, 16,000 in "
        "Sponza), 320 x 180, truth to 2 % (hall 4 %, atrium 6 %, Sponza 8 %), on two threads of "
        "an AMD EPYC (Zen 5) under PoCL 3.0 and the limits of `vega56`. Times are blank where "
        "others computed meanwhile. "
        + (f"Not measured yet: {', '.join(missing)}." if missing else "All rows are measured."),
        shown,
    ]
    (asked.table / "defaults.md").write_text("\n\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
