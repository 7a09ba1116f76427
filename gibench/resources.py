"""Data files that travel with the package: kernels, built-in scenes, published results,
others' measurements that projections are held against.

In a checkout they live at the top of the repository; in a wheel, under ``gibench/_data``.
"""

from __future__ import annotations

from importlib.resources import as_file, files
from importlib.resources.abc import Traversable
from pathlib import Path

from gibench.errors import GibenchError

_IN_CHECKOUT = {
    "kernels_cl": ("kernels_cl",),
    "scenes": ("scenes",),
    "published": ("results", "published"),
    "validation": ("results", "validation"),
}


def data(folder: str) -> Traversable:
    """The data folder called ``folder``: ``kernels_cl``, ``scenes``, ``published``, ``validation``.

    Raises:
        GibenchError: the installation lacks it.
    """
    package = files("gibench")
    installed = package / "_data" / folder
    if installed.is_dir():
        return installed
    with as_file(package) as root:
        checkout = Path(root).parent.joinpath(*_IN_CHECKOUT[folder])
    if checkout.is_dir():
        return checkout
    raise GibenchError(
        f"the data folder '{folder}' is missing from this installation",
        mend="reinstall gibench",
    )
