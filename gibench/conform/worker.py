"""One case in a process of its own: what it finds goes to standard output, a line of JSON each.

Usage: python -m gibench.conform.worker DEVICE SEED CASE [KERNEL_ROOT]
"""

from __future__ import annotations

import json
import sys
import zlib
from pathlib import Path

import numpy as np

MARK = "gibench-conform "
"""Before each line of ours: drivers write to standard output, too."""


def main(device: int, seed: int, name: str, root: Path | None) -> None:
    """Run a case at each of its sizes."""
    from gibench.conform.cases import cases
    from gibench.device import list_devices
    from gibench.errors import CannotRun
    from gibench.techniques.parts.conformance.case import Bench

    case, bench = cases()[name], Bench(list_devices()[device], root)
    for size in case.sizes:
        said: dict[str, object] = {"size": size}
        rng = np.random.default_rng([seed, size, zlib.crc32(name.encode())])
        try:
            said["off"] = max(case.check(bench, rng, size))
        except CannotRun as error:
            said["cannot"] = str(error)
        except Exception as error:  # whatever a driver or its compiler may raise
            said["broken"] = f"{type(error).__name__}: {error}"
        # On a line of its own, even where a driver has left one unended.
        sys.stdout.write("\n" + MARK + json.dumps(said) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    given = sys.argv[1:]
    main(int(given[0]), int(given[1]), given[2], Path(given[3]) if len(given) > 3 else None)
