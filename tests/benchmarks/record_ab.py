"""Record a kernel revision against itself and against kernels made slower, for judge_ab.py.

For every case one line per pair of fresh processes and row (the frame, a pass) goes to a CSV file,
timed exactly as ``gibench ab`` does (gibench.measure.compare.lockstep); the cases take turns,
pair by pair:

- ``same``: the revision against itself,
- ``slower10``, ``slower25``: against copies whose forward render does real extra arithmetic, 10 %
  and 25 % of its device time (calibrated here first, and what was reached is recorded).

It appends and goes on where it stopped. Run it on a quiet machine; 200 pairs of each case take
about 40 minutes on two cores:

    python tests/benchmarks/record_ab.py --pairs 200 --out tests/benchmarks/ab_recording.csv
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from gibench.measure.compare.ab import AbOptions, bake_once, log_ratios
from gibench.measure.compare.kernel_trees import kernel_tree
from gibench.measure.compare.lockstep import time_pair
from gibench.measure.compare.replicate import Place
from gibench.measure.machine.environment import device_record, environment, versions
from gibench.measure.plan.grid import grid
from gibench.profiles import load_profile
from gibench.techniques.job import Job, Shot
from gibench.techniques.registry import find_technique

COLUMNS = (
    *("case", "pair", "row", "log_ratio", "old_ms", "new_ms"),
    *("seconds", "load_average"),
)
CASES = {"same": 0.0, "slower10": 0.10, "slower25": 0.25}
SLOWED = "camera"
HEAD, BODY = f"__kernel void {SLOWED}(", "\n{\n"
EXTRA = """    // Extra arithmetic, to be found as a regression: a chain of {turns} multiply-adds.
    float extra = (float)get_global_id(0);
    for (int i = 0; i < {turns}; ++i)
        extra = extra * 0.999f + 0.25f;
    if (extra < 0.0f) // never
        image[0] = extra;
"""
FIRST_TURNS = 200


def slowed_tree(base: Path, folder: Path, turns: int) -> Path:
    """A copy of the kernel tree ``base`` whose forward render does ``turns`` multiply-adds more."""
    root = folder / f"extra{turns}"
    if not root.exists():
        shutil.copytree(base, root)
        # Which file the pass is built from is the technique's choice: every one is slowed.
        for file in root.rglob("*.cl"):
            text = file.read_text()
            if HEAD in text:
                start = text.index(BODY, text.index(HEAD)) + len(BODY)
                file.write_text(text[:start] + EXTRA.format(turns=turns) + text[start:])
    return root


def calibrate(
    job: Job, place: Place, base: Path, folder: Path, aim: float, options: AbOptions
) -> tuple[int, float]:
    """Turns that make the slowed pass slower by ``aim``, and what they reached."""
    rng = np.random.default_rng(1)
    turns, each = FIRST_TURNS, []
    for _ in range(8):
        root = slowed_tree(base, folder, turns)
        ratios = [one_pair(job, place, base, root, options, rng)[1][SLOWED] for _ in range(7)]
        reached = float(np.expm1(np.median(ratios)))
        print(f"  {turns} turns: {SLOWED} {100 * reached:+.1f} %", flush=True)
        if abs(reached - aim) < 0.01:
            return turns, reached
        # The cost grows with the turns; what all tries say of one turn, within a factor of four.
        each.append(max(reached, 0.0) / turns)
        cost = float(np.median(each))
        wanted = aim / cost if cost > 0 else 4 * turns
        turns = max(1, round(min(max(wanted, turns / 4), 4 * turns)))
    raise SystemExit(f"cannot make {SLOWED} {100 * aim:.0f} % slower: the machine is busy")


def one_pair(job, place, old, new, options, rng):
    """Times and log ratios of one pair, and the seconds it took."""
    begin = time.monotonic()
    sides = (replace(place, kernel_root=str(root)) for root in (old, new))
    times = time_pair(job, *sides, frames=options.frames, warmup=options.warmup, rng=rng)
    ratios = {name: values[0] for name, values in log_ratios([times]).items()}
    return times, ratios, time.monotonic() - begin


def rows_of(case: str, pair: int, times, ratios, seconds: float) -> Iterator[tuple]:
    """Lines of the recording."""
    for name, ratio in ratios.items():
        yield (
            *(case, pair, name, f"{ratio:.6f}"),
            *(f"{np.median(side[name]):.5f}" for side in (times.old, times.new)),
            *(f"{seconds:.2f}", f"{os.getloadavg()[0]:.2f}"),
        )


def recorded(path: Path) -> dict[str, int]:
    """How many pairs of every case are there; a pair cut short is taken off the end."""
    lines = path.read_text().splitlines(keepends=True)
    while len(lines) > 1 and not lines[-1].endswith("\n"):
        lines.pop()
    rows = list(csv.DictReader(lines))
    names = {row["row"] for row in rows}
    while rows and len(rows) % len(names):
        rows.pop()
        lines.pop()
    path.write_text("".join(lines))
    return {case: len({r["pair"] for r in rows if r["case"] == case}) for case in CASES}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--revision", default=".", help="kernel tree or git revision")
    parser.add_argument("--pairs", type=int, default=200, help="of every case")
    parser.add_argument("--out", type=Path, default=Path(__file__).with_name("ab_recording.csv"))
    parser.add_argument("--cache-dir", type=Path, default=Path.home() / ".cache" / "gibench")
    parser.add_argument("--technique", default="srp")
    parser.add_argument("--scene", default="cornell-box")
    return parser.parse_args()


def main() -> None:
    """Calibrate, or take the calibration of the recording that is there, and record."""
    given = arguments()
    options = AbOptions()
    given.cache_dir.mkdir(parents=True, exist_ok=True)
    place = Place(str(given.cache_dir), device=0)
    (job,) = grid(
        [load_profile("iphone7")],
        [find_technique(given.technique)],
        scenes=(given.scene,),
        shot=Shot(320, 180),
    )
    bake_once(job, given.cache_dir)
    about_path = given.out.with_suffix(".json")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        # A copy: the tree may change under a recording that takes an hour.
        tree = kernel_tree(given.revision, folder)
        base = folder / "base"
        shutil.copytree(tree.root, base)
        if given.out.exists():
            about = json.loads(about_path.read_text())
            if about["kernels"] != tree.content_hash:
                raise SystemExit(f"{given.out} is of other kernels; record to another file")
            done = recorded(given.out)
        else:
            about = begin(job, place, base, folder, options, tree.content_hash)
            about_path.write_text(json.dumps(about, indent=2) + "\n")
            given.out.write_text(",".join(COLUMNS) + "\n")
            done = dict.fromkeys(CASES, 0)
        roots = {
            case: slowed_tree(base, folder, about["turns"][case]) if slower else base
            for case, slower in CASES.items()
        }
        rng = np.random.default_rng()
        for pair in range(min(done.values()), given.pairs):
            for case in rng.permutation(list(CASES)):
                if done[case] > pair:
                    continue
                times, ratios, seconds = one_pair(job, place, base, roots[case], options, rng)
                with given.out.open("a", newline="") as file:
                    csv.writer(file, lineterminator="\n").writerows(
                        rows_of(case, pair, times, ratios, seconds)
                    )
            if sys.stderr.isatty() or pair % 10 == 9:
                print(f"{pair + 1} of {given.pairs} pairs of every case", flush=True)


def begin(job, place, base, folder, options, kernels) -> dict:
    """Calibrate; what the recording is of."""
    from gibench.device.selection import list_devices

    about = {
        "kernels": kernels,
        "job": job.record(),
        "frames": options.frames,
        "warmup": options.warmup,
        "environment": environment(),
        "device": device_record(list_devices()[0]),
        "versions": versions(),
        "turns": {},
        "reached": {},
    }
    for case, aim in CASES.items():
        if aim:
            print(f"calibrating {case}", flush=True)
            turns, reached = calibrate(job, place, base, folder, aim, options)
            about["turns"][case], about["reached"][case] = turns, reached
    return about


if __name__ == "__main__":
    main()
