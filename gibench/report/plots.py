"""Plots and picture panels, as PNG and SVG."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gibench.measure.runfolder.folder import write_atomically
from gibench.report.colors import distinct
from gibench.techniques.registry import techniques

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito (2008), "Color Universal Design": told apart by nearly everyone.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442")

# Of techniques: the first four of those and four more, which stand out from white and from
# near-black alike (contrast 3 and more).
TECHNIQUE_COLORS = (*COLORS[:4], "#9A7D00", "#8B6FD0", "#7B7F86", "#2A9FB5")


def technique_colors(names: Iterable[str]) -> dict[str, str]:
    """Each technique's own colour, the same in every plot; others than gibench's take the rest. No
    two have the same.
    """
    ours, shown = tuple(techniques()), tuple(dict.fromkeys(names))
    every = (*ours, *(name for name in shown if name not in ours))
    colors = dict(zip(every, distinct(TECHNIQUE_COLORS, len(every)), strict=True))
    return {name: colors[name] for name in shown}


# Okabe and Ito's that stand out from white and near-black alike, then two more.
PASS_COLORS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#9A7D00",
    "#3E8FC9",
    "#8C564B",
    "#7B7F86",
)


def pass_colors(names: Iterable[str]) -> dict[str, str]:
    """A colour for each pass, whatever technique it is of; no two have the same."""
    every = tuple(dict.fromkeys(names))
    return dict(zip(every, distinct(PASS_COLORS, len(every)), strict=True))


@dataclass(frozen=True)
class Series:
    """One line of a plot.

    Attributes:
        label: in the legend.
        x: places.
        y: values; NaN leaves a gap.
        line: slope and intercept of a fitted line to draw through, or None.
        published: whether it is somebody else's figure, drawn dashed and hollow.
        points: not joined.
        color: its own, or None for the next in turn.
    """

    label: str
    x: Sequence[float]
    y: Sequence[float]
    line: tuple[float, float] | None = None
    published: bool = False
    points: bool = False
    color: str | None = None


@dataclass(frozen=True)
class Axes:
    """One set of axes.

    Attributes:
        title: above it.
        x: what is along it, with unit.
        y: what is up it, with unit.
        series: the lines.
        log_x: logarithmic.
        log_y: logarithmic.
        level: a horizontal line with a label, or None.
        marks: labelled points (x, y, text).
        limit: a vertical line, or None.
    """

    title: str
    x: str
    y: str
    series: Sequence[Series] = ()
    log_x: bool = False
    log_y: bool = False
    level: tuple[float, str] | None = None
    marks: Sequence[tuple[float, float, str]] = field(default_factory=tuple)
    limit: float | None = None


def new_figure(width: float, height: float) -> Figure:
    """An empty figure (inches) that no window belongs to."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Empty

    figure = Empty(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path, *, vector: bool = True) -> None:
    """Write ``path`` with .png and, where ``vector``, .svg; the same content, the same bytes.

    Raises:
        GibenchError: the disk refuses.
    """
    import matplotlib as mpl

    with mpl.rc_context({"svg.hashsalt": "gibench", "svg.fonttype": "none"}):
        for kind in ("png", "svg") if vector else ("png",):
            content = BytesIO()
            metadata = {"Date": None} if kind == "svg" else {"Software": "gibench"}
            figure.savefig(content, format=kind, dpi=110, metadata=metadata)
            write_atomically(path.with_name(f"{path.name}.{kind}"), content.getvalue())


def plot(path: Path, axes: Sequence[Axes], caption: str) -> None:
    """Axes side by side with a caption beneath, as ``path``.png and .svg.

    Raises:
        GibenchError: the disk refuses.
    """
    figure = new_figure(5.2 * len(axes), 4.2)
    for number, item in enumerate(axes, 1):
        where = figure.add_subplot(1, len(axes), number)
        for color, series in zip(distinct(COLORS, len(item.series)), item.series, strict=True):
            _draw(where, series, series.color or color)
        where.set(title=item.title, xlabel=item.x, ylabel=item.y)
        if item.log_x:
            where.set_xscale("log")
        if item.log_y:
            where.set_yscale("log")
        elif item.series and np.nanmin([*(v for s in item.series for v in s.y), 0.0]) >= 0:
            where.set_ylim(bottom=0)
        if item.level is not None:
            where.axhline(item.level[0], color="grey", linewidth=0.8, linestyle=":")
            where.annotate(
                item.level[1],
                (1.0, item.level[0]),
                xycoords=("axes fraction", "data"),
                fontsize=7,
                ha="right",
                va="bottom",
                color="grey",
            )
        if item.limit is not None:
            where.axvline(item.limit, color="grey", linewidth=0.8, linestyle=":")
        for x, y, text in item.marks:
            where.annotate(text, (x, y), fontsize=6, xytext=(3, 3), textcoords="offset points")
        if len(item.series) > 1 or (item.series and item.series[0].label):
            where.legend(fontsize=7)
    figure.supxlabel(caption, fontsize=7, color="dimgrey")
    save(figure, path)


def bars(path: Path, groups: Mapping[str, Mapping[str, float]], y: str, caption: str) -> None:
    """Grouped bars: a group of bars per key, one bar per inner key.

    Raises:
        GibenchError: the disk refuses.
    """
    kinds = list(dict.fromkeys(kind for bars_of in groups.values() for kind in bars_of))
    figure = new_figure(max(6.0, 1.1 * len(groups) * max(1, len(kinds)) / 2 + 2), 4.2)
    where = figure.add_subplot()
    width = 0.8 / max(1, len(kinds))
    for number, (kind, color) in enumerate(zip(kinds, distinct(COLORS, len(kinds)), strict=True)):
        at = np.arange(len(groups)) + (number - (len(kinds) - 1) / 2) * width
        heights = [values.get(kind, float("nan")) for values in groups.values()]
        drawn = where.bar(at, heights, width, label=kind, color=color)
        where.bar_label(drawn, fmt="%.3g", fontsize=6)
    where.set_xticks(np.arange(len(groups)), list(groups), fontsize=8)
    where.set_ylabel(y)
    where.legend(fontsize=7)
    figure.supxlabel(caption, fontsize=7, color="dimgrey")
    save(figure, path)


@dataclass(frozen=True)
class Picture:
    """A picture of a panel.

    Attributes:
        title: above it.
        pixels: (h, w, 3) 8-bit sRGB, or (h, w) values drawn through a colour map.
        colors: the colour map's name, for values.
        limits: what its ends stand for.
        unit: beside its bar.
    """

    title: str
    pixels: npt.NDArray[Any] = field(repr=False)
    colors: str = "inferno"
    limits: tuple[float, float] = (0.0, 1.0)
    unit: str = ""


def panel(path: Path, rows: Sequence[Sequence[Picture | None]], caption: str = "") -> None:
    """Pictures in rows, those of values with their scale, as ``path``.png; None leaves a place.

    Raises:
        GibenchError: the disk refuses.
    """
    columns = max(len(row) for row in rows)
    height, width = next(p for row in rows for p in row if p is not None).pixels.shape[:2]
    figure = new_figure(4.2 * columns, (4.2 * height / width + 0.35) * len(rows))
    for i, row in enumerate(rows):
        for j, picture in enumerate(row):
            if picture is None:
                continue
            where = figure.add_subplot(len(rows), columns, i * columns + j + 1)
            where.set_axis_off()
            where.set_title(picture.title, fontsize=8)
            if picture.pixels.ndim == 3:
                where.imshow(picture.pixels)
                continue
            low, high = picture.limits
            drawn = where.imshow(picture.pixels, cmap=picture.colors, vmin=low, vmax=high)
            bar = figure.colorbar(drawn, ax=where, shrink=0.7)
            bar.set_label(picture.unit, fontsize=7)
            bar.ax.tick_params(labelsize=6)
    if caption:
        figure.supxlabel(caption, fontsize=7, color="dimgrey")
    save(figure, path, vector=False)


def _draw(where: Any, series: Series, color: str) -> None:
    if series.published:
        where.plot(series.x, series.y, "--s", color=color, mfc="none", label=series.label)
        return
    fitted = series.line
    style = "o" if fitted is not None or series.points else "-o"
    where.plot(series.x, series.y, style, color=color, label=series.label, markersize=4)
    if fitted is not None and len(series.x):
        ends = np.array([min(series.x), max(series.x)])
        where.plot(ends, fitted[0] * ends + fitted[1], "-", color=color, linewidth=0.9)
