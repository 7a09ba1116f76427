"""Fills the tables of docs/surfel-cache.md from the experiments' results, the paper's beside ours.

Each stands between ``<!-- table NAME -->`` and ``<!-- end -->`` in the page; a figure that was not
measured, or that the paper's copy withholds, is a dash.

Usage: python surfel_tables.py [RESULTS [PAGE]]
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results" / "reference" / "pocl-epyc-zen5-2-threads" / "experiments"
PAGE = ROOT / "docs" / "surfel-cache.md"
PUBLISHED = ROOT / "results" / "published" / "surfel_caches.csv"

SURFELS = (16_384, 32_768, 65_536, 131_072)
LINKS = (32, 64, 128, 254)
BANDS = (2, 3, 4)
SETUPS = tuple((setup, how) for setup in ("high", "moderate") for how in ("stored", "runtime"))
SIZES = ("960x540", "1920x1080", "3840x2160")
GPUS = ("GTX 980", "GTX 850M")
NONE = "–"
_BLOCK = re.compile(r"(<!-- table ([\w-]+) -->\n).*?(<!-- end -->)", re.S)


def one(table: pd.DataFrame, column: str, **key: Any) -> float | None:
    """The value of ``column`` in the one row of ``key``; None where there is none."""
    for name, value in key.items():
        if name not in table:
            return None
        table = table[table[name] == value]
    if len(table) != 1 or column not in table or pd.isna(table[column].iloc[0]):
        return None
    return float(table[column].iloc[0])


def theirs(where: str, quantity: str, **key: Any) -> str:
    """A published figure."""
    table = pd.read_csv(PUBLISHED)
    table = table[(table["where"] == where) & (table["quantity"] == quantity)]
    value = one(table, "value", **key)
    return NONE if value is None else f"{value:.2f}"


def ms(value: float | None) -> str:
    """A time of ours."""
    return NONE if value is None else f"{value:.3g}"


def percent(value: float | None) -> str:
    """An error of ours."""
    return NONE if value is None else f"{100 * value:.1f} %"


def mib(value: float | None) -> str:
    """Bytes of ours."""
    return NONE if value is None else f"{value / 2**20:.1f}"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def mean_of(table: pd.DataFrame, column: str, **key: Any) -> float | None:
    """The mean over rows that differ in nothing that ``column`` depends on."""
    for name, value in key.items():
        if name not in table:
            return None
        table = table[table[name] == value]
    found = table[column].dropna() if column in table else pd.Series(dtype=float)
    return None if found.empty else float(found.mean())


def figure_8(links: pd.DataFrame) -> str:
    """Surfel lighting and pull by surfels, cache lighting by surfels and links."""
    head = ["ms, ours / theirs", *(f"{n:,}".replace(",", " ") for n in SURFELS)]
    rows = []
    for title, name in (("surfel lighting", "surfel_lighting"), ("pull", "pull")):
        cells = [
            f"{ms(mean_of(links, f'{name}_ms', surfels=n))} / {theirs('figure 8', name, surfels=n)}"
            for n in SURFELS
        ]
        rows.append([title, *cells])
    for count in LINKS:
        cells = [
            f"{ms(one(links, 'cache_lighting_ms', surfels=n, links=count))} / "
            f"{theirs('figure 8', 'cache_lighting', surfels=n, links=count)}"
            for n in SURFELS
        ]
        rows.append([f"cache lighting, {count} links", *cells])
    return markdown(head, rows)


def figure_8_errors(links: pd.DataFrame) -> str:
    """Bias and relative L2 by surfels and links."""
    head = ["links: bias, relative L2", *(f"{n:,}".replace(",", " ") for n in SURFELS)]
    rows = [
        [
            str(count),
            *(
                ", ".join(
                    percent(one(links, name, surfels=n, links=count)) for name in ("bias", "rel_l2")
                )
                for n in SURFELS
            ),
        ]
        for count in LINKS
    ]
    return markdown(head, rows)


def table_2(frames: pd.DataFrame) -> str:
    """Every pass of both set-ups at 1920 x 1080."""
    names = ("surfel_lighting", "pull", "cache_lighting", "dilation", "forward_render", "camera")
    head = ["set-up", "links", *(name.replace("_", " ") for name in names), "MiB"]
    rows = []
    for setup, how in SETUPS:
        key = {"setup": setup, "projection": how, "image": "1920x1080"}
        own = [ms(one(frames, f"{name}_ms", **key)) for name in names]
        rows.append([setup, how, *own, mib(one(frames, "memory_bytes", **key))])
    for setup, surfels, lighting in (
        ("high", 131_072, theirs("figure 8", "cache_lighting", surfels=131_072, links=254)),
        ("moderate", 32_768, theirs("section 5.3", "cache_lighting", setup="moderate")),
    ):
        own = [theirs("figure 8", name, surfels=surfels) for name in ("surfel_lighting", "pull")]
        held = theirs("section 5.3.1", "memory stored", setup=setup)
        rows.append([f"theirs, {setup}", "stored", *own, lighting, *([NONE] * 3), held])
    return markdown(head, rows)


def images(frames: pd.DataFrame) -> str:
    """Images of the high set-up with and without indirect light."""
    head = ["image", "without", "with", "with, projected at run time", "theirs, without", "with"]
    rows = []
    for size in SIZES:

        def own(how: str, *names: str, size: str = size) -> str:
            found = [
                one(frames, f"{name}_ms", setup="high", projection=how, image=size)
                for name in names
            ]
            values = [value for value in found if value is not None]
            return ms(sum(values) if len(values) == len(names) else None)

        shown = [
            theirs("section 5.3", f"shading {how} indirect light", resolution=size)
            for how in ("without", "with")
        ]
        both = "camera", "forward_render"
        rows.append([size, own("stored", "camera"), own("stored", *both), own("runtime", *both)])
        rows[-1] += shown
    return markdown(head, rows)


def table_3(bands: pd.DataFrame) -> str:
    """Cache lighting and shading by bands."""
    head = ["ms", *(f"{count} bands" for count in BANDS)]
    rows = []
    for title, name, quantity in (
        ("cache lighting", "cache_lighting", "cache_lighting"),
        ("shading", "forward_render", "shading"),
    ):
        for how in ("stored", "runtime"):
            own = [ms(one(bands, f"{name}_ms", projection=how, bands=n)) for n in BANDS]
            rows.append([f"{title}, {how}", *own])
        for gpu in GPUS:
            shown = [theirs("table 3", quantity, device=gpu, bands=n) for n in BANDS]
            rows.append([f"{title}, theirs, {gpu}", *shown])
    for how in ("stored", "runtime"):
        for title, name in (("bias", "bias"), ("relative L2", "rel_l2")):
            own = [percent(one(bands, name, projection=how, bands=n)) for n in BANDS]
            rows.append([f"{title}, {how}", *own])
    return markdown(head, rows)


def table_4(memory: pd.DataFrame) -> str:
    """Memory: declared, allocated, and table 4's sums."""
    head = ["set-up", "links", "published there", "table 4 summed", "declared here", "held here"]
    rows = []
    for setup, how in SETUPS:
        key = {"setup": setup, "projection": how}
        shown = theirs("section 5.3.1", f"memory {how}", setup=setup)
        summed = one(memory, "table_4_bytes", **key)
        own = [mib(one(memory, f"{name}_bytes", **key)) for name in ("declared", "allocated")]
        rows.append([setup, how, shown, NONE if summed is None else f"{summed / 2**20:.2f}", *own])
    return markdown(head, rows)


def density(table: pd.DataFrame) -> str:
    """Caches, hierarchies, relaxation."""
    head = ["what", "", "caches", "bias", "relative L2", "FLIP", "cache lighting, ms", "MiB"]
    rows = [
        [
            str(row["study"]),
            str(row["value"]),
            str(int(row["caches"])),
            percent(row["bias"]),
            percent(row["rel_l2"]),
            f"{row['flip']:.3f}",
            NONE if pd.isna(row["cache_lighting_ms"]) else ms(row["cache_lighting_ms"]),
            mib(row["memory_bytes"]),
        ]
        for row in table.to_dict("records")
    ]
    return markdown(head, rows)


def gloss(table: pd.DataFrame) -> str:
    """A glossy floor, by the truth's lobe."""
    head = ["lobe in truth", "held against it", "n", "bias", "relative L2", "FLIP", "noise of L2"]
    if "truth" not in table:
        return markdown(head, [])
    rows = [
        [
            str(row["truth"]),
            str(row["setting"]),
            f"{row['exponent']:g}",
            percent(row["bias"]),
            percent(row["rel_l2"]),
            f"{row['flip']:.3f}",
            percent(row["rel_l2_noise"]),
        ]
        for row in table.to_dict("records")
    ]
    return markdown(head, rows)


def failures(table: pd.DataFrame) -> str:
    """Where it fails, and the lamps."""
    head = ["scene", "setting", "bias", "relative L2", "FLIP", "light where truth has none"]
    rows = [
        [
            str(row["case"]),
            str(row["setting"]),
            percent(row["bias"]),
            percent(row["rel_l2"]),
            NONE if pd.isna(row["flip"]) else f"{row['flip']:.3f}",
            NONE if pd.isna(row["dark"]) else percent(row["dark"]),
        ]
        for row in table.to_dict("records")
    ]
    return markdown(head, rows)


TABLES: dict[str, tuple[str, Callable[[pd.DataFrame], str]]] = {
    "figure-8": ("surfel-links", figure_8),
    "figure-8-errors": ("surfel-links", figure_8_errors),
    "table-2": ("surfel-frame", table_2),
    "images": ("surfel-frame", images),
    "table-3": ("surfel-bands", table_3),
    "table-4": ("surfel-memory", table_4),
    "density": ("surfel-density", density),
    "gloss": ("surfel-gloss", gloss),
    "failures": ("surfel-failures", failures),
}
"""By name: the experiment, and what makes the table of its rows."""


def filled(page: str, results: Path) -> str:
    """The page with its tables made anew.

    Raises:
        KeyError: it asks for a table that there is not.
    """

    def table(found: re.Match[str]) -> str:
        experiment, make = TABLES[found[2]]
        file = results / experiment / f"{experiment}.csv"
        rows = pd.DataFrame({"status": []})
        if file.is_file():
            rows = pd.read_csv(file)
        return found[1] + "\n" + make(rows[rows["status"] == "ok"]) + "\n" + found[3]

    return _BLOCK.sub(table, page)


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else RESULTS
    path = Path(sys.argv[2]) if len(sys.argv) > 2 else PAGE
    path.write_text(filled(path.read_text(encoding="utf-8"), folder), encoding="utf-8")
