"""What SRP cannot do while objects move is told before anything is baked."""

from __future__ import annotations

import pytest

from gibench.commands import asked
from gibench.device.selection import select_cl_device
from gibench.errors import BadInput, CannotRun
from gibench.measure.session.session import Session, check_job
from gibench.measure.session.shared import Shared


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Shared:
    return Shared(tmp_path_factory.mktemp("cache"), 0)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"srp.sky": "receivers"}, "srp.sky=receivers knows nothing of what moves"),
        ({"srp.receiver_order": 1, "srp.gloss": True}, "shade scenes in which nothing moves"),
        ({"srp.receiver_order": 1, "srp.normal_maps": True}, "shade scenes in which nothing"),
    ],
)
def test_settings_that_suit_nothing_that_moves(
    settings: dict[str, object], told: str, shared: Shared, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Shared, "baked", lambda *_, **__: pytest.fail("it bakes"))
    given = {
        "device_profile": "iphone7",
        "scene": "hall-door",
        "technique": "srp",
        "seed": 0,
        "variant": "tuned",
        "sh_order": None,
        "probes": None,
        "receivers": 50,
        "workgroup_size": None,
        "settings": settings,
        "resolution": "16x8",
    }
    for motion in ("scene", "rest"):
        (job,) = asked.jobs_of({**given, "motion": motion})
        if motion == "rest":
            check_job(job, shared)
            continue
        with pytest.raises(BadInput, match=told) as refused:
            check_job(job, shared)
        assert "leave out --motion" in str(refused.value)
        with pytest.raises(CannotRun, match=told):
            Session.open(job, shared, select_cl_device(None))
    (job,) = asked.jobs_of({**given, "settings": None, "motion": "scene"})
    check_job(job, shared)
