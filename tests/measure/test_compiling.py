"""No frame compiles: kernels are built for their launches ahead, and nothing else changes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

_FRAMES = """
import json, sys
from pathlib import Path
from gibench.device.device import select_cl_device
from gibench.measure.session.session import Session
from gibench.measure.session.shared import Shared
from gibench.profiles import load_profile
from gibench.techniques.job import Job, Shot
from gibench.techniques.registry import find_technique

spec, profile = find_technique("gibs"), load_profile("iphone7")
job = Job("gibs", spec.settings({}), "tuned", "cornell-box", profile, 64, 500, shot=Shot(160, 90))
session = Session.open(job, Shared(Path(sys.argv[1]), 0), select_cl_device(None))
session.prepare(whole=True)
if sys.argv[2] == "ahead":
    session.compile()
walls = [session.frame(number).wall_ms for number in range(12)]
print(json.dumps({"walls": walls, "sum": float(session.irradiance().sum())}))
"""


def test_with_a_cold_kernel_cache_no_frame_compiles(tmp_path: Path) -> None:
    told = {}
    for when in ("late", "ahead"):
        environment = {**os.environ, "POCL_CACHE_DIR": str(tmp_path / when)}
        (tmp_path / when).mkdir()
        done = subprocess.run(
            [sys.executable, "-c", _FRAMES, str(tmp_path / "cache"), when],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        told[when] = json.loads(done.stdout.splitlines()[-1])
    late, ahead = told["late"], told["ahead"]
    print(late, ahead)
    assert max(late["walls"]) > 200  # it does cost that much
    assert max(ahead["walls"]) < 0.25 * max(late["walls"])
    assert late["sum"] == ahead["sum"]
