"""Run whole, undrawn `gibench ab` checks and record what each of them says.

judge_ab.py draws checks from a recording; this runs the command itself, as CI would, on the same
kernels: against themselves and against the copies of ab_recording.json that were made slower. The
cases take turns in random order. One line per check goes to the CSV file, which it goes on with:

    python tests/benchmarks/real_ab_checks.py --each 4
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from record_ab import CASES, SLOWED, slowed_tree

from gibench.measure.compare.kernel_trees import kernel_tree

COLUMNS = (
    *("case", "expected_exit", "exit", "pairs", "seconds", "load_average"),
    *("frame_ratio", "frame_verdict", f"{SLOWED}_ratio", f"{SLOWED}_verdict", "slower"),
)


def check(old: Path, new: Path) -> tuple[int, dict]:
    """Exit code and JSON of one `gibench ab OLD NEW`."""
    command = [sys.executable, "-m", "gibench", "ab", str(old), str(new)]
    done = subprocess.run([*command, "--json", "-"], capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise SystemExit(done.stderr)
    return done.returncode, json.loads(done.stdout)


def line(case: str, code: int, found: dict) -> list:
    """A line of the CSV file."""
    rows = {row["row"]: row for row in found["rows"]}
    pairs = max(len(values) for values in found["log_ratios"].values())
    out = [case, int(CASES[case] > 0), code, pairs, found["seconds"], round(os.getloadavg()[0], 2)]
    for name in ("frame", SLOWED):
        out += [round(rows[name]["ratio"], 4), rows[name]["verdict"]]
    return [*out, " ".join(found["slower"])]


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--each", type=int, default=4, help="checks of every case")
    here = Path(__file__)
    parser.add_argument("--recording", type=Path, default=here.with_name("ab_recording.json"))
    parser.add_argument("--out", type=Path, default=here.with_name("ab_real_checks.csv"))
    given = parser.parse_args()
    turns = json.loads(given.recording.read_text())["turns"]
    if not given.out.exists():
        given.out.write_text(",".join(COLUMNS) + "\n")
    done = [row["case"] for row in csv.DictReader(given.out.open())]
    rng = np.random.default_rng()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        base = folder / "base"
        shutil.copytree(kernel_tree(".", folder).root, base)
        for turn in range(given.each):
            for case in rng.permutation(list(CASES)):
                if done.count(case) > turn:
                    continue
                new = slowed_tree(base, folder, turns[case]) if CASES[case] else base
                found = line(case, *check(base, new))
                with given.out.open("a", newline="") as file:
                    csv.writer(file, lineterminator="\n").writerow(found)
                print(*found, flush=True)


if __name__ == "__main__":
    main()
