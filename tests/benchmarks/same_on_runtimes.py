"""One seed, one bake, the same frames on several OpenCL runtimes: how far apart is what they show?

    python same_on_runtimes.py record OUT.npz [--device N] [--cache-dir DIR]
    python same_on_runtimes.py compare ONE.npz OTHER.npz ...

``record`` runs every technique, as published and tuned in both layouts, for ``FRAMES`` frames of
the Cornell Box on one device and keeps the last frame's image and irradiance. What is baked is
baked by whoever records first and read by the others: it is frames that are compared.
``compare`` prints a Markdown table, for every recording against the first: how many pixels differ
by over ``EDGE`` of the largest value, and the largest difference of the others and of a receiver,
over the largest value.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

FRAMES = 32
"""The first 24 fill probes and surfels; all of them are run, whatever has settled."""
DENSE = ("gibs.placement_chance=0.8", "gibs.surfels=4000", "surfel-cache.surfels=4096")
EDGE = 1e-3
"""Of the largest value: a pixel further off shows another surface."""
Recorded = dict[str, npt.NDArray[np.float32]]
SHAPES = (("published", None), ("tuned", "wide"), ("tuned", "simt"))


def record(out: Path, device: int, cache: Path) -> None:
    """Run every configuration on a device."""
    from gibench.commands import asked
    from gibench.device import list_devices
    from gibench.errors import GibenchError
    from gibench.measure.session.session import Session
    from gibench.measure.session.shared import Shared
    from gibench.techniques.registry import techniques

    cl_device = list_devices()[device]
    found: dict[str, npt.NDArray[np.float32]] = {}
    print(f"{cl_device.platform.name}: {cl_device.name.strip()}", flush=True)
    shared = Shared(cache, 5)
    for name in techniques():
        for variant, layout in SHAPES:
            given = {
                "device_profile": "iphone7",
                "scene": "cornell-box",
                "technique": name,
                "variant": variant,
                "layout": layout,
                "sh_order": None,
                "probes": 8 if name == "srp" else None,
                "receivers": 2000,
                "workgroup_size": 64,
                "settings": [one for one in DENSE if one.startswith(name + ".")],
                "resolution": "160x90",
                "seed": 5,
            }
            (job,) = asked.jobs_of(given)
            label = " ".join(filter(None, (name, variant, layout)))
            try:
                with Session.open(job, shared, cl_device) as session:
                    session.prepare(whole=True)
                    for number in range(FRAMES):
                        session.frame(number)
                    found[f"{label}: image"] = session.technique.images()["frame"]
                    light = session.technique.indirect_irradiance()
                    found[f"{label}: irradiance"] = np.asarray(light, np.float32)
            except GibenchError as error:
                print(f"{label}: {error}", flush=True)
                continue
            print(label, flush=True)
    np.savez_compressed(out, allow_pickle=False, **found)  # type: ignore[arg-type]


def compare(paths: list[Path]) -> None:
    """Print the table."""
    first, *others = (dict(np.load(path)) for path in paths)
    heads = (f"{path.stem}: pixels | the others | irradiance" for path in paths[1:])
    print(f"| {paths[0].stem} against | " + " | ".join(heads) + " |")
    print("|---|" + "--:|--:|--:|" * len(others))
    for label in dict.fromkeys(what.rpartition(": ")[0] for what in first):
        cells = []
        for other in others:
            if f"{label}: irradiance" not in other:
                cells += ["did not run", "", ""]
                continue
            pixel = apart(first, other, f"{label}: image").max(axis=2)
            near = pixel[pixel <= EDGE].max(initial=0.0)
            light = float(apart(first, other, f"{label}: irradiance").max())
            cells += [str(int((pixel > EDGE).sum())), told(float(near)), told(light)]
        print(f"| {label} | " + " | ".join(cells) + " |")


def apart(first: Recorded, other: Recorded, what: str) -> npt.NDArray[np.float64]:
    """Absolute differences over the largest value."""
    values = first[what].astype(np.float64)
    most = max(float(np.abs(values).max()), 1e-30)
    return np.asarray(np.abs(other[what] - values) / most)


def told(difference: float) -> str:
    """A difference for the table."""
    return f"{difference:.0e}" if difference else "same"


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("record", help="run everything on one device")
    one.add_argument("out", type=Path, metavar="OUT.npz")
    one.add_argument("--device", type=int, default=0)
    one.add_argument("--cache-dir", type=Path, default=Path("same-on-runtimes"))
    two = commands.add_parser("compare", help="compare recordings with the first")
    two.add_argument("recordings", type=Path, nargs="+", metavar="OUT.npz")
    given = parser.parse_args()
    if given.command == "record":
        given.cache_dir.mkdir(parents=True, exist_ok=True)
        record(given.out, given.device, given.cache_dir)
    else:
        compare(given.recordings)
    return 0


if __name__ == "__main__":
    sys.exit(main())
