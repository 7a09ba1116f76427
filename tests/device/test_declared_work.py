"""The work every pass declares against what Oclgrind counts its kernels to do.

Every pass of every technique and variant is run: what is counted must be within 10 % of what is
declared, or within the bounds that EXPLAINED gives with a reason. Declared is the least that the
algorithm needs, so most reasons say what a kernel does beyond it.

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

import json
import os
import re
import subprocess
import sys
from collections import Counter
from dataclasses import asdict
from importlib import import_module
from importlib.util import find_spec
from math import inf
from pathlib import Path
from typing import Any

import pytest
from support.oclgrind_runner import ONE_THREAD, SCRIPTS, needs_oclgrind

from gibench.techniques.registry import techniques

sys.path.insert(0, str(SCRIPTS))

from cases import Case

pytestmark = [pytest.mark.oclgrind, needs_oclgrind]

QUANTITIES = ("flops", "bytes_read", "bytes_written", "rays", "atomics")
SIZE = 16
WIDE = 16  # floats of a vector, for packets of rays; elsewhere one, so that operations are counted

# By technique: frames, image width and height, and settings beside those of run_case.SMALL: enough
# surfels and probes for what is done once to be little.
SHAPES: dict[str, tuple[int, int, int, dict[str, Any]]] = {
    "gibs": (8, 48, 32, {}),
    "ddgi": (3, 18, 17, {"probes": 27, "rays": 64, "fixed_rays": 16, "distance_texels": 6}),
    "srp": (2, 18, 17, {"relight_samples": 100}),
}
SHAPE_OF_OTHERS: tuple[int, int, int, dict[str, Any]] = (2, 18, 17, {})

# Settings that change what is declared: the slower half of the test.
OTHER_SETTINGS: list[tuple[str, dict[str, Any]]] = [
    ("srp", {"storage": "fp32"}),
    ("srp", {"storage": "snorm16", "bounces": False}),
    ("gibs", {"depth_moments": False, "ray_guiding": True}),
    ("ddgi", {"storage": "fp32", "relocation": False}),
]

CHANNELS = "three channels count as one operation"
AGAIN = "the compiler stores three channels again where the fourth is a constant"
HANDED = "its kernels hand data to each other through memory"
SHARED = "what all share counts for each: "

# Passes of scenes in which something moves, declared once for all techniques.
MOVING = {"move_vertices", "refit_leaves", "refit_nodes"}

# (technique, variant or "", pass, quantity): bounds of counted / declared, and why; where nothing
# is declared, bounds of what is counted.
EXPLAINED: dict[tuple[str, str, str, str], tuple[float, float, str]] = {
    # -- what moves ----------------------------------------------------------------------------
    ("direct", "tuned", "move_vertices", "flops"): (0.75, 0.9, CHANNELS),
    ("direct", "tuned", "move_vertices", "bytes_read"): (
        *(1.0, 3.0),
        SHARED + "the object's transform",
    ),
    ("direct", "tuned", "refit_leaves", "bytes_read"): (
        *(1.3, 2.0),
        SHARED + "a triangle reads the corners it shares with others",
    ),
    ("direct", "tuned", "refit_nodes", "bytes_read"): (
        *(1.1, 1.3),
        "which triangles are missing in a block is read for each axis",
    ),
    # -- SRP -----------------------------------------------------------------------------------
    ("srp", "published", "probe_update", "flops"): (
        *(1.0, 1.25),
        "work-items add up their shares: few samples, so that they show",
    ),
    ("srp", "tuned", "probe_update", "bytes_read"): (
        *(1.5, 2.6),
        SHARED + "each probe reads the basis; a radiance has a fourth channel",
    ),
    ("srp", "published", "probe_update", "bytes_read"): (
        *(3.7, 6.3),
        SHARED + "the basis is read for each of three channels",
    ),
    ("srp", "tuned", "cluster_projection", "bytes_read"): (
        *(1.4, 3.3),
        SHARED + "a block of rows reads the probes' coefficients",
    ),
    ("srp", "published", "cluster_projection", "bytes_read"): (
        *(3.7, 11.0),
        SHARED + "each row reads the probes' coefficients and the columns' places",
    ),
    ("srp", "tuned", "irradiance_transport", "bytes_read"): (
        *(2.6, 7.0),
        SHARED + "each vector of receivers reads the light basis vectors",
    ),
    ("srp", "published", "irradiance_transport", "bytes_read"): (
        *(3.3, 9.0),
        SHARED + "each receiver reads the light basis vectors and its cluster's row",
    ),
    ("srp", "tuned", "irradiance_transport", "bytes_written"): (
        28 / 12 - 0.05,
        28 / 12 + 0.1,
        AGAIN,
    ),
    ("srp", "published", "irradiance_transport", "bytes_written"): (1.6, 20 / 12 + 0.1, AGAIN),
    ("srp", "", "dilate", "flops"): (0.45, 0.65, CHANNELS + "; valid neighbours are counted"),
    ("srp", "tuned", "dilate", "bytes_read"): (9.0, 16.0, SHARED + "eight texels read a neighbour"),
    ("srp", "published", "dilate", "bytes_read"): (
        *(10.0, 18.0),
        SHARED + "eight texels read a neighbour, and each whether it is valid",
    ),
    ("srp", "", "application", "flops"): (
        *(1.3, 1.55),
        "a pixel's direction, of no use to this lookup, unless the compiler leaves it out",
    ),
    ("srp", "", "application", "bytes_read"): (
        *(4.3, 5.3),
        SHARED + "the triangles' places in the atlas, the map's texels",
    ),
    # -- GIBS ----------------------------------------------------------------------------------
    ("gibs", "", "transform_and_count", "flops"): (0.7, 1.0, CHANNELS),
    ("gibs", "", "transform_and_count", "bytes_read"): (
        *(3.0, 6.2),
        SHARED + "the object's transform, the grid, the camera",
    ),
    ("gibs", "published", "transform_and_count", "bytes_written"): (
        *(2.2, 3.4),
        "counts are cleared first: four bytes a cell, of which there are 12 a surfel here",
    ),
    ("gibs", "tuned", "prefix_sum", "bytes_read"): (3.0, 3.5, "two passes over padded blocks"),
    ("gibs", "published", "prefix_sum", "bytes_read"): (5.5, 7.0, HANDED + ", level by level"),
    ("gibs", "published", "prefix_sum", "bytes_written"): (2.8, 3.6, HANDED + ", level by level"),
    ("gibs", "published", "finalise", "flops"): (0.4, 0.6, CHANNELS),
    ("gibs", "published", "finalise", "bytes_read"): (2.3, 3.9, SHARED + "the grid and the frame"),
    ("gibs", "tuned", "finalise", "bytes_read"): (
        *(1.0, 14.0),
        "lists are sorted, and what a lookup reads is copied beside them",
    ),
    ("gibs", "tuned", "finalise", "bytes_written"): (
        *(1.0, 17.0),
        "44 bytes an entry of what a lookup reads, beside its ID",
    ),
    ("gibs", "", "irradiance", "flops"): (0.6, 0.95, CHANNELS),
    ("gibs", "", "irradiance", "bytes_written"): (1.4, 2.4, HANDED + ": requests, rays, light"),
    ("gibs", "", "camera", "bytes_written"): (1.05, 1.2, AGAIN),
    ("gibs", "tuned", "application", "flops"): (
        *(10.0, 20.0),
        "a pixel goes through its cell's list; one of its surfels is declared",
    ),
    ("gibs", "published", "application", "flops"): (
        *(26.0, 50.0),
        "a pixel goes through its cell's longer list; one of its surfels is declared",
    ),
    ("gibs", "", "application", "bytes_read"): (2.6, 5.8, SHARED + "surfels, by their pixels"),
    ("gibs", "tuned", "application", "bytes_written"): (
        *(1.0, 1.15),
        "irradiance is copied beside the lists",
    ),
    ("gibs", "", "application", "atomics"): (0, 48 * 32 / 16, "a pixel in 16 marks its surfels"),
    ("gibs", "", "placement", "flops"): (0.7, 1.25, CHANNELS + "; a draw for every tile"),
    ("gibs", "", "placement", "bytes_read"): (
        3.0,
        5.8,
        SHARED + "the inverse transform, the frame",
    ),
    ("gibs", "", "recycling", "flops"): (0, 42 * 60, "few surfels are drawn and looked up"),
    ("gibs", "", "recycling", "bytes_read"): (
        *(7.0, 15.0),
        SHARED + "frame and counters; " + HANDED + "; few surfels are looked up",
    ),
    ("gibs", "", "recycling", "bytes_written"): (3.5, 4.8, HANDED + ": keep, sum, survivors, list"),
    # -- DDGI ----------------------------------------------------------------------------------
    ("ddgi", "", "probe_trace", "bytes_written"): (1.5, 1.9, AGAIN),
    ("ddgi", "tuned", "probe_shade", "bytes_written"): (
        *(1.45, 1.55),
        "front or back and the distance's square are kept too: six floats of four",
    ),
    ("ddgi", "tuned", "blend_irradiance", "flops"): (
        *(1.1, 1.7),
        "a texel's weights are computed for few probes here, then its new value",
    ),
    ("ddgi", "published", "blend_irradiance", "flops"): (
        *(2.8, 4.5),
        "every probe computes all weights anew, and weighs rays behind the texel by 0",
    ),
    ("ddgi", "tuned", "blend_irradiance", "bytes_read"): (
        *(14.0, 32.0),
        SHARED + "each texel reads the rays that it is lit by, and its list",
    ),
    ("ddgi", "published", "blend_irradiance", "bytes_read"): (
        *(2.9, 6.0),
        SHARED + "three batches of texels stage a probe's rays and their directions",
    ),
    ("ddgi", "tuned", "blend_irradiance", "bytes_written"): (
        *(1.5, 2.3),
        HANDED + ": the lists, for few probes here; a texel has a fourth channel",
    ),
    ("ddgi", "published", "blend_irradiance", "bytes_written"): (
        *(1.1, 1.35),
        "a texel has a fourth channel",
    ),
    ("ddgi", "tuned", "blend_distance", "flops"): (
        *(1.6, 2.8),
        "a texel's weights, powers of a cosine, are computed for few probes here",
    ),
    ("ddgi", "published", "blend_distance", "flops"): (
        *(20.0, 36.0),
        "every probe computes all weights anew, a power each; one ray in seven counts",
    ),
    ("ddgi", "tuned", "blend_distance", "bytes_read"): (
        *(10.0, 26.0),
        SHARED + "each texel reads the rays that count for it, and its list",
    ),
    ("ddgi", "published", "blend_distance", "bytes_read"): (
        *(4.4, 11.0),
        SHARED + "three batches of texels stage a probe's rays and their directions",
    ),
    ("ddgi", "tuned", "blend_distance", "bytes_written"): (
        *(1.2, 2.2),
        HANDED + ": the lists, for few probes here",
    ),
    ("ddgi", "", "application", "flops"): (0.75, 0.95, CHANNELS),
    ("ddgi", "", "application", "bytes_read"): (
        *(22.0, 34.0),
        SHARED + "the volume, the maps of the eight probes around a pixel, a triangle's corners",
    ),
    ("ddgi", "", "relocation", "flops"): (1.0, 2.4, "and the step of the probes that move"),
    ("ddgi", "", "relocation", "bytes_read"): (1.1, 1.6, SHARED + "spacing and directions"),
    ("ddgi", "", "classification", "flops"): (
        *(27 / 3 - 0.1, 27 / 3 + 0.1),
        "every probe divides for all rays; " + CHANNELS,
    ),
    ("ddgi", "", "classification", "bytes_read"): (2.7, 4.7, SHARED + "the rays' directions"),
    ("ddgi", "", "variability", "bytes_read"): (
        *(1.9, 2.1),
        SHARED + "a probe's state, by its texels",
    ),
    ("ddgi", "", "variability", "bytes_written"): (3.0, 12.0, HANDED + ": a sum a group"),
}


def explained() -> dict[tuple[str, str, str, str], tuple[float, float, str]]:
    """All explanations: a technique may bring its own as ``EXPLAINED`` of a module
    ``explained``, by variant, pass and quantity.
    """
    found = dict(EXPLAINED)
    for name, spec in techniques().items():
        package = ".".join(spec.create.__module__.split(".")[:3])
        if hasattr(import_module(package), "__path__") and find_spec(f"{package}.explained"):
            own = import_module(f"{package}.explained").EXPLAINED
            found |= {(name, *key): bounds for key, bounds in own.items()}
    return found


def cases() -> list[Any]:
    """Every technique and variant; with other settings as slow tests."""
    found: list[Any] = [
        Case("frames", SIZE, width, spec.name, variant, SHAPES.get(spec.name, SHAPE_OF_OTHERS)[3])
        for spec in techniques().values()
        for variant in spec.variants
        for width in (1, *([WIDE] if (spec.name, variant) == ("direct", "tuned") else []))
    ]
    found.append(Case("moving", SIZE, 1, "direct", "tuned"))
    for name, settings in OTHER_SETTINGS:
        for variant in techniques()[name].variants:
            case = Case("frames", SIZE, 1, name, variant, {**SHAPES[name][3], **settings})
            found.append(pytest.param(case, marks=pytest.mark.slow, id=str(case)))
    return found


def bounds_of(case: Case, name: str, quantity: str, said: float) -> tuple[float, float]:
    """Bounds of counted over declared, or of counted where nothing is declared."""
    for variant in (case.variant, ""):
        if found := explained().get((case.technique, variant, name, quantity)):
            return found[0], found[1]
    return (0.9, 1.1) if said else (0.0, 0.0)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a bake serves both variants."""
    return tmp_path_factory.mktemp("baked")


@pytest.mark.parametrize("case", cases(), ids=str)
def test_passes_do_what_they_declare(cache: Path, case: Case) -> None:
    declared, counted = counts(cache, case)
    assert list(counted) == list(declared)
    wrong = []
    for name, work in declared.items():
        for quantity in QUANTITIES:
            done, said = counted[name][quantity], work[quantity]
            low, high = bounds_of(case, name, quantity, said)
            if quantity == "bytes_read" and counted[name]["traced"]:
                # Other loads hide among those of the tree, but none may be missing.
                low, high = min(said, 0.9), inf
            if quantity == "rays" and case.width == WIDE:
                low, high = 1 / WIDE, 1.0  # a packet counts as a ray
            ratio = done / said if said else done
            if not low <= ratio <= high:
                wrong.append(f"{name}: {quantity}: {done} of {said}: {ratio:.2f}")
    assert not wrong, "\n".join(wrong)
    if case.what == "moving":
        assert set(declared) >= MOVING
    elif case.settings == SHAPES.get(case.technique, SHAPE_OF_OTHERS)[3]:
        told = {name for technique, _, name, _ in explained() if technique == case.technique}
        assert told - MOVING <= set(declared)


def test_explanations_are_needed() -> None:
    """Of a technique and variant there is, and of more than 10 %."""
    for (technique, variant, _, quantity), (low, high, why) in explained().items():
        assert variant in ("", *techniques()[technique].variants)
        assert quantity in QUANTITIES
        assert low < high, why
        assert low > 1.0 or high > 1.1 or low < 0.9


def counts(cache: Path, case: Case) -> tuple[dict[str, dict[str, float]], dict[str, Counter[str]]]:
    """By pass: the work it declares, and what Oclgrind counts it to do in its last frame."""
    shape = SHAPES.get(case.technique, SHAPE_OF_OTHERS)[:3]
    ran = subprocess.run(
        [
            *(*ONE_THREAD, "--inst-counts", sys.executable),
            *(str(SCRIPTS / "counts_under_oclgrind.py"), str(cache)),
            *(*(str(n) for n in shape), json.dumps(asdict(case))),
        ],
        env=dict(os.environ, PYOPENCL_NO_CACHE="1"),
        capture_output=True,
        text=True,
        timeout=200,
    )
    assert ran.returncode == 0, ran.stderr
    declared: dict[str, dict[str, float]] = {}
    counted: dict[str, Counter[str]] = {}
    now: Counter[str] | None = None
    kernel: Counter[str] = Counter()
    for line in [*ran.stdout.splitlines(), "END"]:
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
