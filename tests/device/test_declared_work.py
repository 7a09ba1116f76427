"""The work every pass declares against what Oclgrind counts its kernels to do.

Every pass of every technique and variant is run: what is counted must be within 10 % of what is
declared. Where it is not, ``declared_work.csv`` in the technique's folder (in that of the parts,
for passes that all share) has the ratio that was counted, with a reason, and what is counted must
be within 10 % of that. Declared is the least that the algorithm needs, so most reasons say what a
kernel does beyond it. The simulator, one thread and one seed count the same every time: a kernel
that comes to do a tenth more or less fails here, and its row is counted anew.

How Oclgrind 21.10 counts, and what follows:

- Loads count each time, from the cache or not; bytes read are declared once each. A load may so
  count many times over; never less than once.
- Operations on vectors count once for all their components, except those whose name has the
  width (``fmuladd.v3f32``, ``dot``): counted flops of three channels may be a third of the true.
- What goes through a builtin (``vload3``, ``vstore_half4``, ``mix``) counts as a call of its name.
- Rays are the calls of ``bvh_ray``. What tracing itself reads and computes depends on the tree and
  is not declared: rays are its measure. Flops and loads of kernels that trace are left out here.
"""

from __future__ import annotations

import csv
import json
import re
import sys
from collections import Counter
from dataclasses import asdict, dataclass
from functools import cache
from math import inf
from pathlib import Path
from typing import Any

import pytest
from support.oclgrind_runner import COUNTING, SCRIPTS, Simulator, needs_oclgrind

import gibench.techniques
from gibench.device import SIMT
from gibench.techniques.parts.recolouring import RECOLOUR
from gibench.techniques.registry import techniques

sys.path.insert(0, str(SCRIPTS))

from cases import WITH_A_LAYOUT, Case
from run_case import bake

pytestmark = [pytest.mark.oclgrind, needs_oclgrind]

QUANTITIES = ("flops", "bytes_read", "bytes_written", "rays", "atomics")
SIZE = 16
WIDE = 16  # floats of a vector, for packets of rays; elsewhere one, so that operations are counted

# By technique: frames, image width and height, and settings beside those of run_case.SMALL: enough
# surfels and probes for what is done once to be little.
SHAPES: dict[str, tuple[int, int, int, dict[str, Any]]] = {
    "gibs": (8, 48, 32, {"placement": "camera"}),
    "ddgi": (3, 18, 17, {"probes": 27, "rays": 64, "fixed_rays": 16, "distance_texels": 6}),
    "srp": (2, 18, 17, {"relight_samples": 100}),
    # All probes hold something from the first frame on.
    "irradiance-probes": (2, 18, 17, {"relit_share": 1.0}),
    "light-field-probes": (2, 18, 17, {"relit_share": 1.0}),
}
SHAPE_OF_OTHERS: tuple[int, int, int, dict[str, Any]] = (2, 18, 17, {})

# Settings that change what is declared: the slower half of the test.
OTHER_SETTINGS: list[tuple[str, dict[str, Any]]] = [
    ("srp", {"storage": "fp32"}),
    ("srp", {"storage": "snorm16", "bounces": False}),
    ("srp", {"receiver_order": 1}),
    ("gibs", {"depth_moments": False, "ray_guiding": True}),
    ("gibs", {"placement": "rays", "bare_chance": 1.0}),
    ("ddgi", {"storage": "fp32", "relocation": False}),
    ("light-field-probes", {"gloss_steps": 3}),
]

# Passes of scenes in which something moves, declared once for all techniques.
MOVING = {"move_vertices", "refit_leaves", "refit_nodes"}
CLOSE = 0.1
TECHNIQUES = Path(gibench.techniques.__file__).parent


@dataclass(frozen=True)
class Explained:
    """A row of a declared_work.csv.

    Attributes:
        variant: it is of, ``simt`` for what ``tuned`` does otherwise in that layout; empty: of
            every variant.
        settings: beside those of ``SHAPES``, as :func:`words` has them; empty: whatever they are.
        name: of the pass.
        quantity: of its work.
        counted: over declared; where nothing is declared, itself.
        why: it is not what is declared.
    """

    variant: str
    settings: str
    name: str
    quantity: str
    counted: float
    why: str


@cache
def explained(where: str) -> tuple[Explained, ...]:
    """The rows of a technique's folder, or of that of the parts."""
    path = TECHNIQUES / where / "declared_work.csv"
    if not path.exists():
        return ()
    with path.open(newline="") as file:
        rows = csv.DictReader(file)
        return tuple(
            Explained(*list(row.values())[:4], float(row["counted"]), row["why"]) for row in rows
        )


def cases() -> list[Any]:
    """Every technique and variant; with other settings as slow tests."""
    found: list[Any] = [
        Case("frames", SIZE, width, spec.name, variant, SHAPES.get(spec.name, SHAPE_OF_OTHERS)[3])
        for spec in techniques().values()
        for variant in spec.variants
        for width in (1, *([WIDE] if (spec.name, variant) == ("direct", "tuned") else []))
    ]
    found += [
        Case("frames", SIZE, 1, name, "tuned", SHAPES.get(name, SHAPE_OF_OTHERS)[3], SIMT)
        for name in WITH_A_LAYOUT
    ]
    found.append(Case("moving", SIZE, 1, "direct", "tuned"))
    # A setting that changes nothing tells its rows from those at rest.
    found.append(Case("moving", SIZE, 1, "srp", "tuned", {**SHAPES["srp"][3], "bounces": True}))
    for name in ("srp", "surfel-cache", "irradiance-probes"):
        settings = SHAPES.get(name, SHAPE_OF_OTHERS)[3]
        case = Case("changing", SIZE, 1, name, "tuned", settings)
        found.append(pytest.param(case, marks=pytest.mark.slow, id=str(case)))
    for name, settings in OTHER_SETTINGS:
        for variant in techniques()[name].variants:
            case = Case("frames", SIZE, 1, name, variant, {**SHAPES[name][3], **settings})
            found.append(pytest.param(case, marks=pytest.mark.slow, id=str(case)))
    return found


def folder(technique: str) -> str:
    """Of ``technique`` in gibench/techniques."""
    return techniques()[technique].create.__module__.split(".")[2]


def words(case: Case) -> str:
    """What sets ``case`` apart from its technique's other cases."""
    usual = SHAPES.get(case.technique, SHAPE_OF_OTHERS)[3]
    told = [f"{k}={v}" for k, v in case.settings.items() if usual.get(k) != v]
    return " ".join([*told, *([f"width={case.width}"] if case.width != 1 else [])])


def rows_of(case: Case, name: str, quantity: str) -> list[Explained]:
    """What explains a count of ``case``, the row that is most its own first."""
    rows = [*explained(folder(case.technique)), *explained("parts")]
    fit = [
        row
        for row in rows
        if (row.name, row.quantity) == (name, quantity)
        and row.variant in ("", case.variant, case.layout)
        and row.settings in ("", words(case))
    ]
    return sorted(fit, key=lambda row: (not row.settings, row.variant != SIMT, not row.variant))


def bounds_of(case: Case, name: str, quantity: str, said: float) -> tuple[float, float]:
    """Bounds of counted over declared, or of counted where nothing is declared."""
    found = rows_of(case, name, quantity)
    expected = found[0].counted if found else float(said > 0)
    return expected * (1 - CLOSE), expected * (1 + CLOSE)


@pytest.fixture(scope="module")
def baked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a bake serves both variants."""
    return tmp_path_factory.mktemp("baked")


@pytest.mark.parametrize("case", cases(), ids=str)
def test_passes_do_what_they_declare(
    tmp_path: Path, baked: Path, oclgrind: Simulator, case: Case
) -> None:
    bake(case, baked)  # not in the simulator, which counts frames
    declared, counted = read_counts(simulated(oclgrind, tmp_path, baked, case))
    assert list(counted) == list(declared)
    wrong = []
    for name, work in declared.items():
        for quantity in QUANTITIES:
            done, said = counted[name][quantity], work[quantity]
            low, high = bounds_of(case, name, quantity, said)
            if quantity == "bytes_read" and counted[name]["traced"]:
                # Other loads hide among those of the tree, but none may be missing.
                low, high = min(said, 0.9), inf
            ratio = done / said if said else done
            if not low <= ratio <= high:
                wrong.append(f"{name}: {quantity}: {done} of {said}: {ratio:.2f}")
    assert not wrong, "\n".join(wrong)
    if case.what == "moving":
        assert set(declared) >= MOVING
    elif case.what == "changing":
        assert RECOLOUR in declared
    else:
        optional = {"relocation", "prefilter", "refit_movers"}
        assert {row.name for row in explained(folder(case.technique))} <= {*declared, *optional}


def test_explanations_are_needed() -> None:
    """Of a variant and a quantity there is, once, and of more than 10 %."""
    files = list(TECHNIQUES.glob("*/declared_work.csv"))
    assert {file.parent.name for file in files} <= {*map(folder, techniques()), "parts"}
    for file in files:
        rows = explained(file.parent.name)
        assert len({(row.variant, row.settings, row.name, row.quantity) for row in rows}) == len(
            rows
        )
        for row in rows:
            assert row.variant in ("", "published", "tuned", "simt")
            assert row.quantity in QUANTITIES
            assert row.settings or abs(row.counted - 1) > CLOSE, row
            assert len(row.why) > 10, row


def simulated(oclgrind: Simulator, folder: Path, cache: Path, case: Case) -> str:
    """What counts_under_oclgrind.py and Oclgrind print."""
    shape = SHAPES.get(case.technique, SHAPE_OF_OTHERS)[:3]
    given = (str(cache), *(str(n) for n in shape), json.dumps(asdict(case)))
    return oclgrind.run(folder, COUNTING, "counts_under_oclgrind.py", *given)


def read_counts(printed: str) -> tuple[dict[str, dict[str, float]], dict[str, Counter[str]]]:
    """By pass: the work it declares, and what Oclgrind counts it to do in its last frame."""
    declared: dict[str, dict[str, float]] = {}
    counted: dict[str, Counter[str]] = {}
    now: Counter[str] | None = None
    kernel: Counter[str] = Counter()
    for line in [*printed.splitlines(), "END"]:
        if line.startswith(("PASS ", "END", "Instructions executed for kernel")):
            if now is not None:
                now += without_tracing(kernel)
            kernel = Counter()
        if line.startswith("PASS "):
            now = counted[line.split()[1]] = Counter()
        elif line.startswith("WORK "):
            _, name, work = line.split(" ", 2)
            declared[name] = json.loads(work)
        elif line.startswith("END"):
            now = None
        elif match := re.match(r"\s+(\d+) - (.*)", line):
            kernel += operations(int(match[1]), match[2])
    return declared, counted


def without_tracing(kernel: Counter[str]) -> Counter[str]:
    """What is compared of a kernel's counts."""
    if kernel["rays"]:
        kernel["flops"] = 0
        kernel["traced"] = 1
    return kernel


BUILTIN_FLOPS = {
    # per component, and what is added to all of them
    "dot": (2, -1),
    "length": (2, 0),
    "distance": (3, 0),
    "normalize": (3, 0),
    "mix": (3, 0),
    **dict.fromkeys(("sqrt", "rsqrt", "powr", "exp", "log", "sin", "cos"), (1, 0)),
    "cross": (3, 0),
    "smoothstep": (7, 0),
}
BYTES = {"f": 4, "i": 4, "j": 4, "h": 1, "Dh": 2, "s": 2, "t": 2}


def operations(times: int, what: str) -> Counter[str]:
    """Oclgrind's line of one instruction or call as the quantities of ``Work``."""
    nbytes = int(match[1]) if (match := re.search(r"global \((\d+) bytes\)", what)) else 0
    if what.startswith("load global"):
        return Counter(bytes_read=nbytes)
    if what.startswith("store global"):
        return Counter(bytes_written=nbytes)
    if what.startswith("call bvh_ray("):
        return Counter(rays=times)
    if what.startswith(("call bvh_closest_packet(", "call bvh_occluded_packet(")):
        return Counter(rays=times)
    if match := re.match(r"call _Z\d+(vload|vstore)(?:_half)?(\d*).*PU3AS1K?(\w+)\(", what):
        kind = "bytes_read" if match[1] == "vload" else "bytes_written"
        return Counter({kind: times * int(match[2] or 1) * BYTES[match[3]]})
    if re.match(r"call _Z\d+atomic_\w+?PU3AS1", what):
        return Counter(atomics=times)
    if match := re.match(r"call llvm\.fmuladd\.(?:v(\d+))?f32", what):
        return Counter(flops=2 * times * int(match[1] or 1))
    if re.match(r"f(add|sub|mul|div)\b", what):
        return Counter(flops=times)
    if (match := re.match(r"call _Z\d+([a-z]+)(?:Dv(\d))?", what)) and match[1] in BUILTIN_FLOPS:
        each, more = BUILTIN_FLOPS[match[1]]
        return Counter(flops=times * (each * int(match[2] or 1) + more))
    return Counter()
