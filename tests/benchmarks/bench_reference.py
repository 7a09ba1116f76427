"""How much of the path-traced reference's time its rays take.

Run with ``pytest tests/benchmarks/bench_reference.py --benchmark-enable -s``. The share is the rate
of rays altogether over embreex's own rate at the same rays, in the same run: what Embree would
reach if nothing had to be shaded, sampled or stored.
"""

import os
from pathlib import Path

import pytest

from gibench.reference.path_tracer import reference_irradiance
from gibench.scene.lightmap.atlas import unwrap
from gibench.scene.load import load_scene

SCENES = Path(
    os.environ.get("GIBENCH_SCENES", Path(__file__).resolve().parents[3] / "shared" / "scenes")
)
SPONZA = SCENES / "sponza_crytek" / "sponza.obj"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "receivers", "paths"),
    [("cornell-box", 40_000, 64), ("hall", 40_000, 64), (str(SPONZA), 50_000, 64)],
)
def test_rays_take_most_of_the_time(request, name, receivers, paths):
    if not request.config.getoption("--benchmark-enable"):
        pytest.skip("a benchmark: run it with --benchmark-enable")
    if name == str(SPONZA) and not SPONZA.is_file():
        pytest.skip(f"{SPONZA} is not here")
    scene = load_scene(name)
    lightmap = unwrap(scene, receivers)
    reference_irradiance(scene, lightmap, paths=8)  # builds kernels
    found = reference_irradiance(scene, lightmap, paths=paths)
    share = found.ray_seconds / found.seconds
    print(
        f"\n{Path(name).name}: {found.rays / 1e6:.0f} million rays in {found.seconds:.1f} s, "
        f"{found.rays / found.seconds / 1e6:.2f} Mrays/s of "
        f"{found.rays / found.ray_seconds / 1e6:.2f} in Embree alone: {share:.0%}"
    )
    assert share >= 0.6
