"""No frame compiles: kernels are built for their launches ahead, and nothing else changes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from gibench.device.selection import select_cl_device
from gibench.errors import CannotRun
from gibench.measure.session.session import Session
from gibench.measure.session.shared import Shared
from gibench.profiles import load_profile
from gibench.techniques.job import Job, Shot
from gibench.techniques.registry import find_technique

_FRAMES = """
import json, os, sys
from pathlib import Path
from gibench.device.selection import select_cl_device
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
built = [each for each in Path(os.environ["POCL_CACHE_DIR"]).rglob("*goffs0*")]
small = sorted({each.parent.name for each in built if each.name.endswith("smallgrid")})
large = sorted({each.parent.name for each in built if not each.name.endswith("smallgrid")})
vary = sorted({launch.launch.kernel for item in session.prepared for launch in item.launches
               if callable(launch.launch.items)})
walls = [session.frame(number).wall_ms for number in range(12)]
print(json.dumps({"walls": walls, "sum": float(session.irradiance().sum()), "vary": vary,
                  "small": small, "large": large}))
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
    # What has more and more to do is compiled for both sizes of grid, before it has anything.
    assert len(ahead["vary"]) >= 4 and set(ahead["vary"]) <= set(ahead["large"])
    assert set(ahead["vary"]) <= set(ahead["small"])


class Broken:
    """A technique's spec of which no second technique can be made."""

    name = "gibs"

    def create(self, *_: object) -> None:
        raise CannotRun("no room for another", where=Path("/somewhere/private/x"))


def test_what_was_not_compiled_ahead_is_said(tmp_path: Path, monkeypatch, caplog) -> None:
    spec, profile = find_technique("direct"), load_profile("iphone7")
    settings, shot = spec.settings({}), Shot(8, 8)
    job = Job("direct", settings, "tuned", "cornell-box", profile, 64, 300, shot=shot)
    session = Session.open(job, Shared(tmp_path, 0), select_cl_device(None))
    session.prepare(whole=True)
    session.compile()
    assert session.notes == [] and not caplog.records
    monkeypatch.setattr("gibench.measure.session.session.find_technique", lambda name: Broken())
    session.compile()
    (note,), (told,) = session.notes, caplog.records
    assert "were not compiled ahead" in note and "no room for another" in note
    assert "/somewhere" not in note and told.levelname == "WARNING" and "direct" in told.message
    assert session.frame(0).wall_ms > 0
