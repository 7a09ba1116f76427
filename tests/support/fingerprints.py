"""Fingerprints of what must not change while the house is rebuilt.

Everything is had through the command line, ``PYTHON -m gibench`` with ``PYTHONPATH`` at a checkout,
and from the files that it leaves: any revision can be recorded, whatever its modules are called::

    python fingerprints.py record --root CHECKOUT --python PYTHON OUT.json [--quick]
    python fingerprints.py compare BEFORE.json AFTER.json [--self SECOND_BEFORE.json ...]

``record`` leaves ``OUT.json`` with hashes and figures, and the arrays beside it in ``OUT.npz``:

* pictures: the pixels of every image of ``gibench run --save-images``, by run, technique, variant,
  work-group size and SH order;
* passes: bytes, flops and rays of each, and their sums over a frame's passes;
* receivers: the arrays of ``gibench quality``'s ``receivers.npz``, the reference among them;
* bakes: every array in every file of a bake's cache, whatever the files are called.

``compare`` prints a Markdown table of what differs (``--all``: of everything) and exits 1 if
anything differs by more than the 'before' revision differs from itself: with ``--self``, by more
than ``--slack`` times as much, in the largest and in the mean difference; without, at all. Passes
that came or went are listed apart and are no failure, nor are the figures of the passes beside them
while the frame's sum stays.

Needs NumPy, pandas and Pillow. Hashes hold for one processor and one OpenCL compiler.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fingerprint_comparison import Comparison
from fingerprint_recording import Recording, record


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("record", help="record a checkout's fingerprints")
    one.add_argument("out", type=Path, metavar="OUT.json")
    one.add_argument("--root", type=Path, required=True, help="checkout to record")
    one.add_argument("--python", type=Path, default=Path(sys.executable), help="that runs it")
    one.add_argument("--quick", action="store_true", help="leave out what takes long")
    one.add_argument("--only", metavar="REGEX", help="only scenarios whose name matches")
    two = commands.add_parser("compare", help="compare two recordings; exits 1 on a difference")
    two.add_argument("before", type=Path, metavar="BEFORE.json")
    two.add_argument("after", type=Path, metavar="AFTER.json")
    two.add_argument(
        "--self",
        type=Path,
        action="extend",
        nargs="+",
        default=[],
        dest="second",
        metavar="SECOND_BEFORE.json",
        help="more recordings of 'before', whole or in part",
    )
    two.add_argument("--slack", type=float, default=2.0, help="times its own difference (2)")
    two.add_argument("--all", action="store_true", help="list what is the same, too")
    given = parser.parse_args()
    if given.command == "record":
        # Not resolved: a virtual environment's Python is a link, and knows itself by its place.
        python = given.python.absolute()
        return record(given.root.resolve(), python, given.out, given.quick, given.only)
    recordings = [Recording.load(path) for path in (given.before, given.after, *given.second)]
    comparison = Comparison(recordings[0], recordings[1], recordings[2:], given.slack)
    comparison.everything()
    print(comparison.told(given.all))
    return 1 if comparison.failed() else 0


if __name__ == "__main__":
    sys.exit(main())
