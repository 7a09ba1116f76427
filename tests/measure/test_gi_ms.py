"""What a technique costs is told apart from the camera: a slow lookup at the pixels is seen."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pandas as pd
import pytest

from gibench.device.selection import select_cl_device
from gibench.measure.plan.grid import grid
from gibench.measure.session.session import Session
from gibench.measure.session.shared import Shared
from gibench.profiles import load_profile
from gibench.report.tables import gi_ms_of
from gibench.techniques.job import Shot
from gibench.techniques.registry import find_technique
from gibench.techniques.technique import CAMERA

TREE = Path(__file__).parents[2] / "kernels_cl"
LOOKUP = re.compile(r"(__kernel void application\([^{]*\{\n)")
PLANTED = """    volatile float extra = 0.0f;
    for (int i = 0; i < 150000; ++i)
        extra = extra * 0.999f + 0.25f;
"""
"""Several times what DDGI's GI takes at this size, whatever else the machine does meanwhile."""
SMALL = {"transport_rays": (32,), "relight_samples": (32,), "sh_order": (1,)}


def slowed(folder: Path) -> Path:
    """The kernels with a lookup at the pixels that takes long, whatever technique's it is."""
    root = folder / "kernels_cl"
    shutil.copytree(TREE, root)
    for file in root.rglob("*.cl"):
        text = file.read_text(encoding="utf-8")
        file.write_text(LOOKUP.sub(lambda m: m[1] + PLANTED, text), encoding="utf-8")
    return root


def stages_ms(name: str, root: Path, cache: Path, frames: int) -> tuple[float, float]:
    """Median of the passes of stage ``gi``, and of the camera's, ms."""
    (job,) = grid(
        [load_profile("iphone7")],
        [find_technique(name)],
        receivers=(400,),
        settings={"srp": SMALL} if name == "srp" else {},
        shot=Shot(64, 36),
    )
    with Session.open(job, Shared(cache, 0), select_cl_device(None), kernel_root=root) as session:
        session.prepare(whole=True)
        passes = [{"pass": item.name, "stage": item.stage} for item in session.prepared]
        rows = [
            {"configuration": 1, "frame": frame, "pass": item, "time_ms": ms}
            for frame in range(frames)
            for item, ms in session.frame(frame).pass_ms.items()
        ]
        samples = pd.DataFrame(rows)
        camera = [item.name for item in session.prepared if item.stage == CAMERA]
    gi = gi_ms_of(samples, {"configurations": [{"configuration": 1, "passes": passes}]})[1]
    taken = samples[samples["pass"].isin(camera)].groupby("frame")["time_ms"].sum()
    return gi, float(taken.median())


@pytest.mark.parametrize("name", ["ddgi", "gibs", "srp"])
def test_a_slow_lookup_is_seen_ingi_ms_of(name: str, tmp_path: Path) -> None:
    gi, camera = stages_ms(name, TREE, tmp_path / "cache", 7)
    slow_gi, slow_camera = stages_ms(name, slowed(tmp_path), tmp_path / "cache", 3)
    assert slow_gi > 2 * gi
    assert abs(slow_camera - camera) < 0.2 * (slow_gi - gi)
