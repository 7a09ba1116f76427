"""False alarms and found regressions of ``gibench ab``, drawn from a recording of record_ab.py.

Every draw is one check: it takes consecutive pairs of processes of one case from a start in the
recording, in order, and stops where ``gibench ab`` would (gibench.measure.compare.paired.sequential
and the 100 seconds it allows itself). All starts that leave enough pairs are drawn.

    python tests/benchmarks/judge_ab.py tests/benchmarks/ab_recording.csv
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from gibench.measure.compare.ab import AbOptions
from gibench.measure.compare.lockstep import FRAME
from gibench.measure.compare.paired import alarmed, judge_rows, looks, undecided


def draw(rows: dict[str, np.ndarray], seconds: np.ndarray, options: AbOptions) -> dict:
    """One check on these consecutive pairs; empty when they run out first."""
    spent = np.cumsum(seconds)
    most = min(options.most, len(spent))
    late = int(np.searchsorted(spent, options.seconds, side="right")) + 1
    for end in sorted({*looks(options.most), late}):
        if end > most:
            break
        judged = judge_rows({name: v[:end] for name, v in rows.items()}, options.threshold)
        if end in (late, options.most) or not undecided(judged):
            return {"pairs": end, "seconds": spent[end - 1], "judged": judged}
    return {}


def judge_case(table: pd.DataFrame, options: AbOptions) -> pd.DataFrame:
    """Every draw of one case."""
    wide = table.pivot_table(index="pair", columns="row", values="log_ratio").sort_index()
    seconds = table.groupby("pair")["seconds"].first().sort_index().to_numpy()
    found = []
    for start in range(len(wide)):
        rows = {str(name): wide[name].to_numpy()[start:] for name in wide}
        if check := draw(rows, seconds[start:], options):
            slower = alarmed(check["judged"])
            found.append(
                {
                    "start": start,
                    "pairs": check["pairs"],
                    "seconds": check["seconds"],
                    "alarm": bool(slower),
                    "frame": check["judged"][FRAME].verdict,
                    "slower": " ".join(slower),
                    "undecided": len(undecided(check["judged"])),
                }
            )
    return pd.DataFrame(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--threshold", type=float, default=AbOptions().threshold)
    parser.add_argument("--seconds", type=float, default=AbOptions().seconds)
    given = parser.parse_args()
    table = pd.read_csv(given.recording)
    options = AbOptions(threshold=given.threshold, seconds=given.seconds)
    for case, mine in table.groupby("case", sort=False):
        spread = mine.groupby("row", sort=False)["log_ratio"].agg(["median", "std"])
        print(f"\n{case}: {mine['pair'].nunique()} pairs; per row median and spread, %:")
        print((100 * spread).round(1).T.to_string())
        checks = judge_case(mine, options)
        if checks.empty:
            print("  too few pairs to draw a check from")
            continue
        print(
            f"  {len(checks)} checks drawn: {100 * checks['alarm'].mean():.1f} % fail "
            f"({100 * (checks['frame'] == 'slower').mean():.1f} % by the frame); "
            f"median pairs {checks['pairs'].median():.0f}, median seconds "
            f"{checks['seconds'].median():.0f}, most {checks['seconds'].max():.0f}; rows undecided "
            f"{checks['undecided'].mean():.1f}"
        )
        print("  verdicts on the frame:", checks["frame"].value_counts().to_dict())


if __name__ == "__main__":
    main()
