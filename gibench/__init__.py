"""gibench: a benchmark suite for real-time diffuse global illumination in OpenCL."""

from __future__ import annotations

import logging
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.1.0"
__all__ = [
    "__version__",
    "ab",
    "advise",
    "bake_ahead",
    "cluster",
    "compare",
    "experiment",
    "load_run",
    "make_report",
    "quality",
    "run",
]

# Warnings are shown where somebody asks for them: the command line does (gibench.cli.notices).
logging.getLogger(__name__).addHandler(logging.NullHandler())


def load_run(path: str | Path) -> Any:
    """A run's folder as pandas tables (:class:`gibench.report.loaded.LoadedRun`): ``samples``,
    ``passes``, ``frames``, and its ``record``.

    Raises:
        BadInput: it is no run of gibench, is damaged, unfinished, or of a newer gibench.
    """
    # By name: pandas is heavy, and the package itself must not depend on its top layers.
    return import_module("gibench.report.loaded").load_run(path)


def run(**options: Any) -> Any:
    """Run techniques frame by frame: all that ``gibench run`` takes, by keyword
    (:func:`gibench.commands.run.run`).

    Returns:
        :class:`gibench.commands.run.RunResult`: ``samples``, ``passes``, ``frames``, ``folder``.
    """
    return import_module("gibench.commands.run").run(**options)


def cluster(**options: Any) -> Any:
    """The executor of a Dask cluster while a ``with`` block runs: ``scheduler``, ``scheduler_file``
    or ``workers`` (:func:`gibench.commands.cluster.cluster`).
    """
    return import_module("gibench.commands.cluster").cluster(**options)


def quality(**options: Any) -> Any:
    """Compare techniques with the path-traced truth: all that ``gibench quality`` takes, by keyword
    (:func:`gibench.commands.quality.quality`).

    Returns:
        :class:`gibench.commands.quality.QualityResult`: ``table``, ``receivers``, ``folder``.
    """
    return import_module("gibench.commands.quality").quality(**options)


def advise(**options: Any) -> Any:
    """Try settings and say which fit a budget: all that ``gibench advise`` takes, by keyword
    (:func:`gibench.commands.advise.advise`).

    Returns:
        :class:`gibench.commands.advise.AdviceResult`: ``table``, ``folder``.
    """
    return import_module("gibench.commands.advise").advise(**options)


def experiment(name: str, **options: Any) -> Any:
    """Repeat one of the papers' experiments: all that ``gibench experiment`` takes, by keyword
    (:func:`gibench.commands.experiment.experiment`).

    Returns:
        :class:`gibench.commands.experiment.ExperimentResult`: ``table``, ``folder``.
    """
    return import_module("gibench.commands.experiment").experiment(name, **options)


def ab(old: str, new: str = ".", **options: Any) -> Any:
    """Time one kernel tree against another: all that ``gibench ab`` takes, by keyword
    (:func:`gibench.commands.ab.ab`).

    Returns:
        :class:`gibench.report.comparison.Comparison`: ``table``, ``remarks``, ``error``.
    """
    return import_module("gibench.commands.ab").ab(old, new, **options)


def compare(base: str | Path, new: str | Path, **options: Any) -> Any:
    """Compare recorded times: all that ``gibench compare`` takes, by keyword
    (:func:`gibench.commands.compare.compare`).

    Returns:
        :class:`gibench.report.comparison.Comparison`: ``table``, ``remarks``, ``error``.
    """
    return import_module("gibench.commands.compare").compare(base, new, **options)


def make_report(runs: Any, **options: Any) -> Any:
    """Show runs again: all that ``gibench report`` takes, by keyword
    (:func:`gibench.commands.report.make_report`).

    Returns:
        :class:`gibench.commands.report.Report`: ``text``, ``path``.
    """
    return import_module("gibench.commands.report").make_report(runs, **options)


def bake_ahead(**options: Any) -> list[Any]:
    """Bake what runs will need: all that ``gibench bake`` takes, by keyword
    (:func:`gibench.commands.bake.bake_ahead`).

    Returns:
        A :class:`gibench.commands.bake.Baked` each.
    """
    return list(import_module("gibench.commands.bake").bake_ahead(**options))
