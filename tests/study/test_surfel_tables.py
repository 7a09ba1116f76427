"""The tables of docs/surfel-cache.md, from rows."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.surfel_tables import NONE, PAGE, TABLES, filled

PAGE_OF_ALL = "".join(f"<!-- table {name} -->\nold\n<!-- end -->\ntext\n" for name in TABLES)


def rows_in(text: str, name: str) -> list[list[str]]:
    """The cells of a filled table, its rule left out."""
    block = text.split(f"<!-- table {name} -->\n")[1].split("<!-- end -->")[0]
    lines = [line for line in block.splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [row for row in cells if row[0] != "---"]


def test_ours_stand_beside_theirs(tmp_path: Path) -> None:
    folder = tmp_path / "surfel-links"
    folder.mkdir()
    head = "surfels,links,surfel_lighting_ms,pull_ms,cache_lighting_ms,bias,rel_l2,status\n"
    lines = "16384,32,1,2,3.14159,0.05,0.1,ok\n16384,64,3,4,7,,,ok\n32768,64,3,4,9,0,0,failed\n"
    (folder / "surfel-links.csv").write_text(head + lines)
    text = filled(PAGE_OF_ALL, tmp_path)
    assert "old" not in text and text.count("text\n") == len(TABLES)
    times = rows_in(text, "figure-8")
    assert times[0][1:] == ["16 384", "32 768", "65 536", "131 072"]
    assert times[1][1] == "2 / 0.03"  # the mean over links
    assert times[3][1:3] == ["3.14 / 0.22", f"{NONE} / 0.24"]
    assert times[4][2] == f"{NONE} / 0.43"  # failed
    errors = rows_in(text, "figure-8-errors")
    assert errors[1][1] == "5.0 %, 10.0 %" and errors[2][1] == f"{NONE}, {NONE}"
    assert rows_in(text, "table-3")[4][1:] == ["3.84", NONE, NONE]  # withheld
    assert filled(text, tmp_path) == text


def test_the_page_asks_for_tables_that_there_are() -> None:
    asked = re.findall(r"<!-- table ([\w-]+) -->", PAGE.read_text(encoding="utf-8"))
    assert set(asked) == set(TABLES) and len(asked) == len(TABLES)
    with pytest.raises(KeyError):
        filled("<!-- table nothing -->\n<!-- end -->", PAGE.parent)
