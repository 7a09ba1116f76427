"""Steps in series of times: planted ones are found where they are, and noise is no step."""

from __future__ import annotations

import numpy as np
import pytest

from gibench.measure.statistics.steps import LEAST_RUNS, MEDIAN_ERROR, find_steps, run_noise

pytest.importorskip("ruptures")


def noisy(rng: np.random.Generator, count: int, scale: float) -> np.ndarray:
    return np.log(5.0) + rng.normal(0, scale, count)


SERIES, BUT = 40, 3
"""Of so many series one in a thousand has a step by chance, or one that is off by two runs: more
than three are a chance of 1 in a million."""


@pytest.mark.parametrize("ratio", [0.8, 1.1, 1.25])
def test_a_step_is_found_where_it_is(rng: np.random.Generator, ratio: float) -> None:
    found = 0
    for _ in range(SERIES):
        logs = noisy(rng, 80, 0.02)
        at = int(rng.integers(20, 60))
        logs[at:] += np.log(ratio)
        steps = find_steps(logs, 0.05)
        if len(steps) != 1 or abs(steps[0].at - at) > 1:
            continue
        (step,) = steps
        found += 1
        assert step.low < ratio < step.high
        error = MEDIAN_ERROR * 0.02 * np.sqrt(1 / at + 1 / (80 - at))
        assert abs(np.log(step.ratio / ratio)) < 6 * error
        assert step.slower == (ratio > 1)
    assert found >= SERIES - BUT


def test_two_steps_are_two(rng: np.random.Generator) -> None:
    found = 0
    for _ in range(SERIES):
        logs = noisy(rng, 90, 0.02)
        logs[30:] += np.log(1.3)
        logs[60:] -= np.log(1.2)
        steps = find_steps(logs, 0.05)
        found += (
            [one.slower for one in steps] == [True, False]
            and abs(steps[0].at - 30) <= 1
            and abs(steps[1].at - 60) <= 1
        )
    assert found >= SERIES - BUT


def test_noise_alone_is_no_step(rng: np.random.Generator) -> None:
    """One series in fifty at most: of a hundred, more than 8 are then a chance of 1 in 4000."""
    found = [find_steps(noisy(rng, 60, 0.05), 0.05) for _ in range(100)]
    assert sum(map(bool, found)) <= 8


def test_outliers_are_no_step(rng: np.random.Generator) -> None:
    found = 0
    for _ in range(SERIES):
        logs = noisy(rng, 60, 0.02)
        logs[[7, 23, 24, 41]] += np.log(3.0)
        found += find_steps(logs, 0.05) != []
    assert found <= BUT


def test_what_is_below_the_threshold_does_not_matter(rng: np.random.Generator) -> None:
    logs = noisy(rng, 200, 0.005)
    logs[100:] += np.log(1.03)
    assert find_steps(logs, 0.05) == []
    assert len(find_steps(logs, 0.02)) == 1


def test_known_noise_holds_a_verdict_back(rng: np.random.Generator) -> None:
    logs = noisy(rng, 40, 0.01)
    logs[20:] += np.log(1.1)
    assert len(find_steps(logs, 0.05)) == 1
    assert find_steps(logs, 0.05, noise=0.2) == []


def test_too_few_runs_tell_nothing() -> None:
    logs = np.log([1.0] * LEAST_RUNS + [9.0] * (LEAST_RUNS - 1))
    assert find_steps(logs, 0.05) == []
    assert len(find_steps(np.append(logs, np.log(9.0)), 0.05)) == 1


def test_noise_is_of_neighbours(rng: np.random.Generator) -> None:
    logs = rng.normal(0, 0.1, 40_000)  # so many tell it to 0.7 %
    assert run_noise(logs) == pytest.approx(0.1, rel=0.05)
    logs[20_000:] += 3.0
    assert run_noise(logs) == pytest.approx(0.1, rel=0.05)
    assert run_noise(logs[:1]) == 0.0
