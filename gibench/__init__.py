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
    "calibrate",
    "check_orders",
    "check_profile",
    "cluster",
    "compare",
    "conform_device",
    "experiment",
    "explain",
    "export_mitsuba",
    "history_add",
    "history_check",
    "history_page",
    "list_devices",
    "list_profiles",
    "list_scenes",
    "list_techniques",
    "load_run",
    "make_gallery",
    "make_report",
    "merge_runs",
    "predict_validation",
    "project_run",
    "quality",
    "run",
    "show_profile",
    "submit",
    "validate_projection",
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


def calibrate(profile: str, **options: Any) -> Any:
    """Measure a profile's machine part on the device: all that ``gibench calibrate`` does
    (:func:`gibench.commands.calibrate.calibrate`).

    Returns:
        A :class:`gibench.commands.calibrate.Calibration`.
    """
    return import_module("gibench.commands.calibrate").calibrate(profile, **options)


def conform_device(**options: Any) -> Any:
    """Compare every kernel with its oracle on a device: all that ``gibench conform`` does
    (:func:`gibench.commands.conform.conform`).

    Returns:
        :class:`gibench.commands.conform.Conformance`: ``kernels``, ``record``, ``error``.
    """
    return import_module("gibench.commands.conform").conform(**options)


def explain(**options: Any) -> Any:
    """Trace launches and say what they do: all that ``gibench explain`` takes, by keyword
    (:func:`gibench.commands.explain.explain`).

    Returns:
        A :class:`gibench.commands.explain.Explanation`.
    """
    return import_module("gibench.commands.explain").explain(**options)


def make_gallery(submissions: Any, **options: Any) -> Any:
    """Write the page of many submissions, as ``gibench gallery`` does
    (:func:`gibench.commands.share.make_gallery`).

    Returns:
        The page's path.
    """
    return import_module("gibench.commands.share").make_gallery(submissions, **options)


def merge_runs(runs: Any, out: str | Path) -> Any:
    """Join shards into the folder ``out``, as ``gibench merge`` does
    (:func:`gibench.commands.merge.merge`).

    Returns:
        A :class:`gibench.commands.merge.Merged`.
    """
    return import_module("gibench.commands.merge").merge(runs, out)


def project_run(run: str | Path, device_profile: Any, **options: Any) -> Any:
    """Project a stored run onto devices that are not here, as ``gibench project`` does
    (:func:`gibench.commands.project.project`).

    Returns:
        :class:`gibench.commands.project.Projection`: ``table``, ``folder``.
    """
    return import_module("gibench.commands.project").project(run, device_profile, **options)


def submit(run: str | Path, **options: Any) -> Any:
    """Pack a run into one file, and send nothing, as ``gibench submit`` does
    (:func:`gibench.commands.share.submit`).

    Returns:
        The file's path.
    """
    return import_module("gibench.commands.share").submit(run, **options)


def validate_projection(**options: Any) -> Any:
    """Score frozen predictions, as ``gibench validate-projection`` does
    (:func:`gibench.commands.validate_projection.validate_projection`).

    Returns:
        A :class:`gibench.commands.validate_projection.Validation`.
    """
    return import_module("gibench.commands.validate_projection").validate_projection(**options)


def predict_validation(folder: str | Path, **options: Any) -> Any:
    """Make predictions anew and freeze them, as ``gibench validate-projection --predict`` does
    (:func:`gibench.commands.validate_projection.predict_validation`).

    Returns:
        A DataFrame, a row a prediction.
    """
    found = import_module("gibench.commands.validate_projection")
    return found.predict_validation(folder, **options)


def check_orders(runs: Any, **options: Any) -> Any:
    """Hold runs' passes against their projection onto the device that ran them, as ``gibench
    validate-projection --here`` does (:func:`gibench.commands.validate_projection.check_orders`).

    Returns:
        Two DataFrames: a row for each runtime and device, and one for each pass.
    """
    return import_module("gibench.commands.validate_projection").check_orders(runs, **options)


def history_add(sources: Any, **options: Any) -> Any:
    """Keep runs in a history, as ``gibench history add`` does
    (:func:`gibench.commands.history.history_add`).

    Returns:
        :class:`gibench.commands.history.Added`: ``new``, ``known``.
    """
    return import_module("gibench.commands.history").history_add(sources, **options)


def history_check(**options: Any) -> Any:
    """Search a history for steps, as ``gibench history check`` does
    (:func:`gibench.commands.history.history_check`).

    Returns:
        :class:`gibench.commands.history.Checked`: ``table``, ``error``.
    """
    return import_module("gibench.commands.history").history_check(**options)


def history_page(**options: Any) -> Any:
    """Write a history's page, as ``gibench history show`` does
    (:func:`gibench.commands.history.history_page`).

    Returns:
        The page's path.
    """
    return import_module("gibench.commands.history").history_page(**options)


def export_mitsuba(scene: str, out: str | Path, **options: Any) -> Any:
    """Write a scene for Mitsuba 3, so that it can check the truth
    (:func:`gibench.commands.export.export_mitsuba`).

    Returns:
        The path of the XML file.
    """
    return import_module("gibench.commands.export").export_mitsuba(scene, out, **options)


def list_scenes() -> Any:
    """The built-in scenes, as ``gibench scenes`` lists them, a DataFrame
    (:func:`gibench.commands.listings.list_scenes`).
    """
    return import_module("gibench.commands.listings").list_scenes()


def list_techniques() -> Any:
    """The techniques' settings, as ``gibench techniques`` lists them, a DataFrame
    (:func:`gibench.commands.listings.list_techniques`).
    """
    return import_module("gibench.commands.listings").list_techniques()


def list_devices() -> Any:
    """The OpenCL devices, as ``gibench devices`` lists them, a DataFrame
    (:func:`gibench.commands.listings.list_devices`).
    """
    return import_module("gibench.commands.listings").list_devices()


def list_profiles() -> Any:
    """The device profiles, as ``gibench profiles`` lists them, a DataFrame
    (:func:`gibench.commands.listings.list_profiles`).
    """
    return import_module("gibench.commands.listings").list_profiles()


def show_profile(name: str) -> Any:
    """A profile, every figure with its source, as ``gibench profiles show`` has it
    (:func:`gibench.commands.listings.show_profile`).

    Returns:
        :class:`gibench.commands.listings.ShownProfile`: ``figures``, ``machine``, ``text``.
    """
    return import_module("gibench.commands.listings").show_profile(name)


def check_profile(name: str) -> Any:
    """What is wrong with a profile, as ``gibench profiles check`` tells it
    (:func:`gibench.commands.listings.check_profile`).

    Returns:
        :class:`gibench.commands.listings.CheckedProfile`: ``faults``, ``estimated``, ``spread``.
    """
    return import_module("gibench.commands.listings").check_profile(name)
