"""Tables, the report and images, from a record written by hand."""

from __future__ import annotations

import re
from dataclasses import asdict
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from gibench.measure.statistics.summary import Roofs
from gibench.report.images import ImageWriter, exposure_of, file_name, png, tone_map
from gibench.report.markdown import report
from gibench.report.tables import csv_text, frames_table, passes_table, run_roofs
from gibench.report.terminal import worst_line
from gibench.techniques.registry import declared_counts

START = Roofs(20.0, 15.0, 200.0, 2.0, 10.0)
WORK = {"flops": 4e8, "bytes_read": 3e7, "bytes_written": 1e7, "rays": 0.0, "atomics": 0.0}


def entry(number: int, **changes: Any) -> dict[str, Any]:
    base = {
        "configuration": number,
        "technique": "srp",
        "variant": "tuned",
        "scene": "box",
        "profile": "iphone7",
        "workgroup_size": 256,
        "sh_order": 2,
        "surfels": None,
        "probes": 27,
        "receivers": 1000,
        "frames": 3,
        "warmup": 1,
        "memory_bytes": 1 << 20,
        "memory_budget_bytes": 1 << 30,
        "status": "ok",
        "reason": "",
        "notes": [],
        "passes": [
            {"pass": "one", "stage": "gi", **WORK, "status": "ok", "reason": ""},
            {
                "pass": "two",
                "stage": "camera",
                **dict.fromkeys(WORK, 0.0),
                "status": "ok",
                "reason": "",
            },
        ],
    }
    return base | changes


def record(*entries: dict[str, Any], end: Roofs = START) -> dict[str, Any]:
    return {
        "interrupted": False,
        "arguments": {"save_images": True},
        "started_utc": "2026-01-01 00:00:00",
        "seed": 0,
        "image": {"width": 1334, "height": 750},
        "versions": {"gibench": "0.1.0"},
        "environment": {
            "cpu": "A CPU",
            "usable_threads": 2,
            "memory_bytes": 8 << 30,
            "os": "An OS",
        },
        "device": {"name": "cpu", "platform": "PoCL", "driver": "3.0"},
        "profiles": [{"name": "iphone7", "title": "Apple iPhone 7"}],
        "roofs": {"start": asdict(START), "end": asdict(end)},
        "scenes": [
            {"name": "box", "triangles": 12, "content_hash": "ab" * 32, "warnings": ["3 dropped"]}
        ],
        "configurations": list(entries),
    }


def samples(number: int, times: list[list[float]], walls: list[float]) -> pd.DataFrame:
    """Rows of (frames, passes) ``times``."""
    return pd.DataFrame(
        [
            {"configuration": number, "pass": name, "frame": frame, "time_ms": ms}
            | {"frame_wall_ms": walls[frame]}
            for frame, row in enumerate(times)
            for name, ms in zip(("one", "two"), row, strict=True)
        ]
    )


TIMES = [[4.0, 1.0], [5.0, 1.5], [9.0, 1.25]]
WALLS = [6.0, 40.0, 50.0]


def test_passes_by_hand() -> None:
    table = passes_table(samples(1, TIMES, WALLS), record(entry(1))).set_index("pass")
    one = table.loc["one"]
    assert (one["mean_ms"], one["median_ms"], one["min_ms"], one["max_ms"]) == (6.0, 5.0, 4.0, 9.0)
    assert one["gb_per_s"] == pytest.approx(8.0)  # 4e7 bytes in 5 ms
    assert one["gflop_per_s"] == pytest.approx(80.0)
    assert one["roofline_fraction"] == pytest.approx(2.0 / 5.0)  # 2 ms by bytes and by flops
    assert np.isnan(one["mrays_per_s"])
    two = table.loc["two"]
    assert two["median_ms"] == 1.25
    assert np.isnan(two["roofline_fraction"])
    assert np.isnan(two["gb_per_s"])


def test_frames_by_hand() -> None:
    table = frames_table(samples(1, TIMES, WALLS), record(entry(1)))
    row = table.iloc[0]
    assert row["median_ms"] == 40.0
    assert row["fps"] == 25.0
    assert not row["real_time"]
    assert row["device_ms"] == 6.5
    assert row["gap_ms"] == 33.5
    fast = frames_table(samples(1, TIMES, [33.3, 33.3, 90.0]), record(entry(1)))
    assert bool(fast["real_time"][0])  # a median of at most 33.3 ms


def test_configurations_are_kept_apart() -> None:
    both = pd.concat([samples(1, TIMES, WALLS), samples(2, [[1.0, 1.0]], [3.0])])
    table = frames_table(both, record(entry(1), entry(2, probes=50)))
    assert list(table["median_ms"]) == [40.0, 3.0]
    assert list(table["frames"]) == [3, 1]
    assert list(table["probes"]) == [27, 50]


def test_half_a_frame_has_no_time() -> None:
    half = entry(1, status="skipped", reason="two: too big")
    half["passes"][1] |= {"status": "skipped", "reason": "too big"}
    data = samples(1, TIMES, WALLS)
    data = data[data["pass"] == "one"]
    frame = frames_table(data, record(half)).iloc[0]
    assert np.isnan(frame["median_ms"])
    assert pd.isna(frame["real_time"])
    assert frame["status"] == "skipped"
    passes = passes_table(data, record(half)).set_index("pass")
    assert passes.loc["one", "median_ms"] == 5.0
    assert passes.loc["two", "reason"] == "too big"


def test_no_samples_at_all_make_tables_still() -> None:
    refused = entry(1, status="skipped", reason="too much", sh_order=None, probes=None)
    refused["passes"] = [{"pass": "(frame)", **WORK, "status": "skipped", "reason": "too much"}]
    nothing = samples(1, TIMES, WALLS).iloc[:0]
    passes, frames = (make(nothing, record(refused)) for make in (passes_table, frames_table))
    assert list(passes["status"]) == ["skipped"]
    assert list(frames["reason"]) == ["too much"]
    line = csv_text(frames).splitlines()[1]
    blank = "," * (1 + len(declared_counts()))  # no SH order, no counts
    assert line.startswith(f"srp,tuned,,box,iphone7,256,{blank}1000,0,")
    assert "nan" not in line.lower()
    assert "too much" in report(passes, frames, record(refused))


def test_csv_has_whole_numbers_whole() -> None:
    text = csv_text(passes_table(samples(1, TIMES, WALLS), record(entry(1))))
    line = text.splitlines()[1]
    heads = text.splitlines()[0].split(",")
    told = dict(zip(heads, line.split(","), strict=True))
    names = ("pass", "probes", "receivers", "frames", "mean_ms", "median_ms")
    assert [told[name] for name in names] == ["one", "27", "1000", "3", "6", "5"]
    assert ",40000000,400000000,0,8,80," in line


def test_the_roofs_of_a_run_are_its_best() -> None:
    end = Roofs(25.0, 10.0, 190.0, 1.0, 12.0)
    assert run_roofs(record(end=end)) == Roofs(25.0, 15.0, 200.0, 1.0, 12.0)
    unmeasured = record()
    for when in ("start", "end"):
        unmeasured["roofs"][when]["mrays_per_s"] = None
    assert np.isnan(run_roofs(unmeasured).mrays_per_s)


def make_report(run: dict[str, Any]) -> str:
    data = samples(1, TIMES, WALLS)
    return report(passes_table(data, run), frames_table(data, run), run)


def test_the_report_says_what_was_measured_and_what_was_not() -> None:
    text = make_report(record(entry(1, notes=["fitted: aims for 9 receivers instead of 10"])))
    assert "**Measured on** A CPU" in text
    assert "**Modelled by its limits, not run:** Apple iPhone 7" in text
    assert "none of the modelled device" in text
    assert "| one | gi | 5.000 |" in text
    assert "fitted: aims for 9 receivers instead of 10" in text
    assert "3 dropped" in text
    assert "ACES" in text
    assert "not steady" not in text
    assert not re.search(r"\bnan\b", text.lower())


def test_the_report_says_at_its_top_when_the_machine_moved() -> None:
    text = make_report(record(entry(1), end=Roofs(17.0, 15.0, 210.0, 9.0, 10.0)))
    head = text[: text.index("## Frames")]
    assert "not steady" in head
    assert "streaming read, GB/s by -15 %" in head
    assert "multiply-add" not in head


def test_a_bar_in_a_reason_does_not_break_the_table() -> None:
    text = make_report(record(entry(1, status="failed", reason="a | b")))
    (line,) = [x for x in text.splitlines() if x.startswith("| srp")]
    assert "a \\| b" in line


def test_tone_mapping_by_hand() -> None:
    image = np.array([[[0, 0, 0], [1, 1, 1], [1e9, 1e9, 1e9], [np.nan, 0, 0]]], float)
    out = tone_map(image, 1.0)
    aces = (2.51 + 0.03) / (2.43 + 0.59 + 0.14)
    grey = round(255 * (1.055 * aces ** (1 / 2.4) - 0.055))
    assert out[0, 0].tolist() == [0, 0, 0]
    assert out[0, 1].tolist() == [grey] * 3
    assert out[0, 2].tolist() == [255] * 3
    assert out[0, 3].tolist() == [255, 0, 255]  # to be seen


def test_tone_mapping_is_monotonic() -> None:
    ramp = np.geomspace(1e-4, 1e3, 500)[None, :, None].repeat(3, axis=2)
    out = tone_map(ramp, 0.7)[0, :, 0].astype(int)
    assert (np.diff(out) >= 0).all()


def test_exposure_is_one_for_all_images_of_a_scene(tmp_path: Path) -> None:
    writer = ImageWriter(tmp_path)
    dark, bright = np.full((8, 8, 3), 0.1), np.full((8, 8, 3), 0.2)
    writer.write("box", "1, srp", {"frame": bright, "direct only": dark})
    writer.write("box", "2, srp", {"frame": dark})
    values = {
        str(path.relative_to(tmp_path)): int(np.asarray(Image.open(path))[0, 0, 0])
        for path in tmp_path.glob("*/*.png")
    }
    assert set(values) == {"1-srp/frame.png", "1-srp/direct-only.png", "2-srp/frame.png"}
    assert values["1-srp/direct-only.png"] == values["2-srp/frame.png"] < values["1-srp/frame.png"]
    assert exposure_of(bright) == pytest.approx(5.0)
    assert exposure_of(np.zeros((2, 2, 3))) == 1.0


def test_png_round_trip(rng: np.random.Generator) -> None:
    pixels = rng.integers(0, 256, (5, 7, 3), np.uint8)
    with Image.open(BytesIO(png(pixels))) as image:
        np.testing.assert_array_equal(np.asarray(image), pixels)


def test_file_names_are_safe() -> None:
    assert file_name("../a/b: c") == "a-b-c"
    assert file_name("///") == "unnamed"


def test_gi_is_the_median_over_frames_of_the_passes_of_its_stage_together() -> None:
    """A lookup that is slow in every frame is seen; the camera's pass is not."""
    stages = {"one": "gi", "two": "camera", "three": "gi", "four": "geometry"}
    passes = [
        {"pass": name, "stage": stage, **WORK, "status": "ok", "reason": ""}
        for name, stage in stages.items()
    ]
    rows = [
        {"configuration": 1, "pass": name, "frame": frame, "time_ms": ms, "frame_wall_ms": 99.0}
        for frame, times in enumerate([(1, 50, 2, 9), (9, 50, 2, 9), (2, 50, 6, 9)])
        for name, ms in zip(stages, times, strict=True)
    ]
    (frame,) = frames_table(pd.DataFrame(rows), record(entry(1, passes=passes))).to_dict("records")
    assert frame["gi_ms"] == 8  # of 3, 11 and 8


def test_gi_is_blank_in_runs_from_before_passes_had_stages() -> None:
    old = entry(1)
    old["passes"] = [
        {key: value for key, value in item.items() if key != "stage"} for item in old["passes"]
    ]
    stored = samples(1, [[1.0, 2.0]] * 3, [4.0] * 3)
    (frame,) = frames_table(stored, record(old)).to_dict("records")
    assert np.isnan(frame["gi_ms"])
    assert "| one |  | " in report(
        passes_table(stored, record(old)), frames_table(stored, record(old)), record(old)
    )


def test_the_worst_line_has_the_machines_own_only_where_it_is_known() -> None:
    frame = {"pace": "bursts", "within_budget": 0.5, "budget": "misses", "longest_ms": 40.0}
    frame |= {"stutter": 2.0, "machine_stutter": float("nan")}
    told = worst_line(pd.Series(frame), 16.7)
    assert "50.0 % of frames within 16.7 ms (misses)" in told
    assert told.endswith("2.0 times its neighbour at most (bursts)")
    told = worst_line(pd.Series(frame | {"machine_stutter": 1.3}), 33.3)
    assert told.endswith("at most (bursts; the machine alone 1.3 times)")
