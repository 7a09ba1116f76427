"""Steps in series of times: planted ones are found where they are, and noise is no step."""

from __future__ import annotations

import numpy as np
import pytest

from gibench.measure.statistics.steps import LEAST_RUNS, find_steps, run_noise

pytest.importorskip("ruptures")


def noisy(rng: np.random.Generator, count: int, scale: float) -> np.ndarray:
    return np.log(5.0) + rng.normal(0, scale, count)


@pytest.mark.parametrize("ratio", [0.8, 1.1, 1.25])
def test_a_step_is_found_where_it_is(rng: np.random.Generator, ratio: float) -> None:
    logs = noisy(rng, 80, 0.02)
    at = int(rng.integers(20, 60))
    logs[at:] += np.log(ratio)
    (step,) = find_steps(logs, 0.05)
    assert abs(step.at - at) <= 1
    assert step.low < ratio < step.high
    assert step.ratio == pytest.approx(ratio, rel=0.02)
    assert step.slower == (ratio > 1)


def test_two_steps_are_two(rng: np.random.Generator) -> None:
    logs = noisy(rng, 90, 0.02)
    logs[30:] += np.log(1.3)
    logs[60:] -= np.log(1.2)
    first, second = find_steps(logs, 0.05)
    assert abs(first.at - 30) <= 1
    assert abs(second.at - 60) <= 1
    assert first.slower
    assert not second.slower


def test_noise_alone_is_no_step(rng: np.random.Generator) -> None:
    """One series in fifty at most: of a hundred, more than 8 are then a chance of 1 in 4000."""
    found = [find_steps(noisy(rng, 60, 0.05), 0.05) for _ in range(100)]
    assert sum(map(bool, found)) <= 8


def test_outliers_are_no_step(rng: np.random.Generator) -> None:
    logs = noisy(rng, 60, 0.02)
    logs[[7, 23, 24, 41]] += np.log(3.0)
    assert find_steps(logs, 0.05) == []


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
    logs = rng.normal(0, 0.1, 4000)
    assert run_noise(logs) == pytest.approx(0.1, rel=0.05)
    logs[2000:] += 3.0
    assert run_noise(logs) == pytest.approx(0.1, rel=0.05)
    assert run_noise(logs[:1]) == 0.0
