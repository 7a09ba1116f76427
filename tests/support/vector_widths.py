"""Which vector widths the kernels' tests can compile for on this machine."""

from typing import Any

import pytest

from gibench.device import list_devices, vector_width


def skip_too_wide(width: int) -> None:
    """Skip the test that asks where the device does not compile for ``width`` floats."""
    if vector_width(list_devices()[0]) == 8 and width > 8:
        pytest.skip("the device compiles for vectors of 8 at most")


def widths(*wanted: Any) -> list[Any]:
    """Parameters whose first (or only) value is a vector width, skipped where it is too wide.

    None stands for the device's own width. Only PoCL compiling for AVX
    without AVX-512 is refused a width (``gibench.device.build``).
    """
    narrow = vector_width(list_devices()[0]) == 8
    skip = pytest.mark.skip(reason="the device compiles for vectors of 8 at most")
    parameters = []
    for given in wanted:
        values = given if isinstance(given, tuple) else (given,)
        marks = [skip] if narrow and values[0] and values[0] > 8 else []
        parameters.append(pytest.param(*values, marks=marks))
    return parameters
