"""A pytest fixture that times OpenCL kernels through pytest-benchmark by the device's own clock.

Where gibench is installed, pytest finds it by itself. Write::

    def test_my_kernel(device_benchmark):
        queue = cl.CommandQueue(
            context, properties=cl.command_queue_properties.PROFILING_ENABLE
        )
        device_benchmark(lambda: kernel(queue, (1 << 20,), (64,), buffer))

Save with ``pytest --benchmark-json new.json`` and hold two files against each other with
``gibench compare old.json new.json``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import pytest

Launches = Callable[[], Any]
"""Enqueues and returns its event, or several."""


@dataclass
class DeviceClock:
    """A clock that only goes on by what the device has worked, seconds."""

    seconds: float = 0.0

    def __call__(self) -> float:
        """The time."""
        return self.seconds

    def run(self, launches: Launches) -> None:
        """Run ``launches``, wait, and go on by the sum of its events' times."""
        returned = launches()
        events = returned if isinstance(returned, Iterable) else [returned]
        for event in [one for one in events if one is not None]:
            event.wait()
            self.seconds += (event.profile.end - event.profile.start) * 1e-9


@dataclass(frozen=True)
class DeviceBenchmark:
    """What the fixture gives; call it with what is to be timed.

    Attributes:
        benchmark: pytest-benchmark's own fixture, for ``group`` and ``extra_info``.
    """

    benchmark: Any

    def __call__(self, launches: Launches, *, rounds: int = 30, warmup_rounds: int = 3) -> None:
        """Time ``launches`` by the device's clock.

        Args:
            launches: enqueues on a queue with profiling and returns its event, or several, of
                which the sum counts; None for nothing to do.
            rounds: times measured.
            warmup_rounds: run before them.
        """
        clock = DeviceClock()
        self.benchmark._timer = clock  # pytest-benchmark takes a timer by marker only: too early
        self.benchmark.pedantic(
            clock.run, args=(launches,), rounds=rounds, iterations=1, warmup_rounds=warmup_rounds
        )


@pytest.fixture
def device_benchmark(benchmark: Any) -> DeviceBenchmark:
    """pytest-benchmark with device time as its timer (see :mod:`gibench.pytest_plugin`)."""
    from gibench.device import list_devices

    list_devices()  # PoCL learns a processor's name that it does not know (gibench.device.pocl)
    return DeviceBenchmark(benchmark)
