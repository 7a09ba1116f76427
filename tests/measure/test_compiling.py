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
sys.path.insert(0, sys.argv[2])
from test_compiling import session_of
session = session_of(Path(sys.argv[1]))
here = Path(os.environ["POCL_CACHE_DIR"])
plain = set(here.rglob("*.so"))
session.compile()
ahead = set(here.rglob("*.so")) - plain
built = list(here.rglob("*goffs0*"))
small = sorted({each.parent.name for each in built if each.name.endswith("smallgrid")})
large = sorted({each.parent.name for each in built if not each.name.endswith("smallgrid")})
vary = sorted({launch.launch.kernel for item in session.prepared for launch in item.launches
               if callable(launch.launch.items)})
for number in range(12):
    session.frame(number)
late = set(here.rglob("*.so")) - ahead - plain
print(json.dumps({"ahead": len(ahead), "late": sorted(map(str, late)), "vary": vary,
                  "small": small, "large": large, "sum": float(session.irradiance().sum())}))
"""


def session_of(cache: Path) -> Session:
    """GIBS, prepared for frames."""
    settings = find_technique("gibs").settings({})
    profile, receivers, shot = load_profile("iphone7"), 500, Shot(160, 90)
    job = Job("gibs", settings, "tuned", "cornell-box", profile, 64, receivers, shot=shot)
    session = Session.open(job, Shared(cache, 0), select_cl_device(None))
    session.prepare(whole=True)
    return session


def test_with_a_cold_kernel_cache_no_frame_compiles(tmp_path: Path) -> None:
    (kernels := tmp_path / "kernels").mkdir()
    done = subprocess.run(
        [sys.executable, "-c", _FRAMES, str(tmp_path / "cache"), str(Path(__file__).parent)],
        env={**os.environ, "POCL_CACHE_DIR": str(kernels)},
        capture_output=True,
        text=True,
        check=True,
    )
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["ahead"] > 9  # to be built for their launches
    assert told["late"] == []
    # What has more and more to do is compiled for both sizes of grid, before it has anything.
    assert len(told["vary"]) >= 4 and set(told["vary"]) <= set(told["large"])
    assert set(told["vary"]) <= set(told["small"])
    # Nothing else changes.
    session = session_of(tmp_path / "cache")
    for number in range(12):
        session.frame(number)
    assert float(session.irradiance().sum()) == told["sum"]


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
