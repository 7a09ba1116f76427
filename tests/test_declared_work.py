"""The work a pass declares against what Oclgrind counts its kernels to do.

Flops and bytes written must agree within 10 %. Bytes read are declared once for each byte, however
often a kernel loads it from the cache, so the loads counted may be more than declared, never less.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from oclgrind_runner import SCRIPTS, needs_oclgrind

pytestmark = [pytest.mark.oclgrind, needs_oclgrind]

PASSES = ("probe_update", "cluster_projection", "irradiance_transport")
WRITTEN_MORE = {
    # Texels are float4, of which three channels are declared (TransportSizes.transport_work);
    # the compiler stores the three again where the fourth is a constant: 16 to 28 bytes for 12.
    "irradiance_transport": (16 / 12, 28 / 12),
}


@dataclass
class Counted:
    declared: dict[str, float]
    flops: int = 0
    loaded: int = 0
    stored: int = 0


def counted(tmp_path: Path, variant: str) -> dict[str, Counted]:
    """What every pass declares and does."""
    ran = subprocess.run(
        [
            *("oclgrind", "--inst-counts", sys.executable),
            *(str(SCRIPTS / "counts_under_oclgrind.py"), "srp", variant, "16"),
            *(str(tmp_path / "cache"), *PASSES),
        ],
        env=dict(os.environ, PYOPENCL_NO_CACHE="1"),
        capture_output=True,
        text=True,
        timeout=200,
    )
    assert ran.returncode == 0, ran.stderr
    found: dict[str, Counted] = {}
    now: Counted | None = None
    for line in ran.stdout.splitlines():
        if line.startswith("PASS "):
            _, name, declared = line.split(" ", 2)
            now = found[name] = Counted(json.loads(declared))
        elif now is not None and (match := re.match(r"\s+(\d+) - (.*)", line)):
            add(now, int(match[1]), match[2])
    return found


def add(pass_: Counted, times: int, what: str) -> None:
    nbytes = int(match[1]) if (match := re.search(r"global \((\d+) bytes\)", what)) else 0
    if what.startswith("load global"):
        pass_.loaded += nbytes
    elif what.startswith("store global"):
        pass_.stored += nbytes
    elif "vload_half" in what:  # a call, whose load is not counted
        pass_.loaded += 2 * times
    elif match := re.match(r"call llvm\.fmuladd\.(?:v(\d+))?f32", what):
        pass_.flops += 2 * times * int(match[1] or 1)
    elif re.match(r"f(add|sub|mul|div)\b", what):
        pass_.flops += times


@pytest.mark.parametrize("variant", ["tuned", "published"])
def test_srp_does_what_it_declares(tmp_path: Path, variant: str) -> None:
    passes = counted(tmp_path, variant)
    assert set(passes) == set(PASSES)
    for name, one in passes.items():
        declared = one.declared
        assert one.flops == pytest.approx(declared["flops"], rel=0.1), name
        least, most = WRITTEN_MORE.get(name, (1.0, 1.0))
        assert 0.9 * least <= one.stored / declared["bytes_written"] <= 1.1 * most, name
        assert one.loaded >= 0.9 * declared["bytes_read"], name
