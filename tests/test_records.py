"""What is committed as measured was measured, and README shows what its run left."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest

from gibench.techniques.registry import techniques

ROOT = Path(__file__).parents[1]
RECORDS = sorted((ROOT / "results" / "reference").rglob("frames.csv"))
ITS_FOLDER = re.compile(r"All of the run above.*?\[its folder\]\((.*?)/report\.md\)", re.S)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("path", RECORDS, ids=lambda path: str(path.parent.relative_to(ROOT)))
def test_a_record_is_of_techniques_that_there_are(path: Path) -> None:
    """A test's run of a made-up technique was once committed in a real one's place."""
    assert {row["technique"] for row in rows(path)} <= {*techniques()}


def test_readme_shows_its_run() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    found = ITS_FOLDER.search(readme)
    assert found is not None
    shown = {
        line.split("│")[1].strip(): line.split("│")
        for line in readme.splitlines()
        if line[:1] == "│"
    }
    which = rows(ROOT / found[1] / "which.csv")
    assert len(which) >= 6
    for row in which:
        cells = [cell.strip() for cell in shown[row["name"]]]
        assert cells[2] == f"{float(row['gi_ms']):.2f}"
        assert cells[4] == f"{float(row['frame_ms']):.2f}"
        assert cells[7] == (f"{100 * float(row['rel_l2']):.1f} %" if row["rel_l2"] else "")
        if row["rel_l2"]:
            told = (
                f"{float(row['gi_ms']):.1f} ms | {float(row['memory_mib']):.1f} MiB | {cells[7]} |"
            )
            assert re.search(rf"^\| `{row['name']}` \|.*\| {re.escape(told)}$", readme, re.M)
