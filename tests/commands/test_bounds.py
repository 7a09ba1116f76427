"""Python is held to the bounds that the command line has."""

from __future__ import annotations

import math
import typing
from typing import Any

import numpy as np
import pytest
import typer

import gibench
from gibench.cli import ab, advise, bake, compare, conform, experiment, quality, run
from gibench.commands.bounds import BOUNDS, within_bounds
from gibench.errors import BadInput

COMMANDS = (
    *(ab.ab, advise.advise, bake.bake, compare.compare, conform.conform),
    *(experiment.experiment, quality.quality, run.run),
)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.__name__)
def test_they_are_the_command_lines(command: Any) -> None:
    for name, hint in typing.get_type_hints(command, include_extras=True).items():
        for option in getattr(hint, "__metadata__", ()):
            if name == "workgroup_size" or name not in BOUNDS:
                # Of the rest none is bounded; a work-group size may be a word.
                assert name in ("workgroup_size", "workers") or option.min is None, name
                continue
            least = -math.inf if option.min is None else option.min
            most = math.inf if option.max is None else option.max
            assert (BOUNDS[name].least, BOUNDS[name].most) == (least, most), name
            assert isinstance(option, typer.models.OptionInfo)


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("frames", 0, "--frames 0 is out of range; give a whole number, 1 or more"),
        ("frames", -5, "--frames -5 is out of range"),
        ("frames", True, "--frames True is not a whole number"),
        ("warmup", -1, "--warmup -1 is out of range"),
        ("warmup_frames", -1, "--warmup-frames -1 is out of range"),
        ("warmup_seconds", -0.5, "--warmup-seconds -0.5 is out of range"),
        ("settle_seconds", float("nan"), "--settle-seconds nan is not a number"),
        ("settle_seconds", -1, "--settle-seconds -1 is out of range"),
        ("receivers", 400.5, "--receivers 400.5 is not a whole number"),
        ("receivers", [400, 0], "--receivers 0 is out of range"),
        ("receivers", "many", "--receivers 'many' is not a whole number"),
        ("seed", -1, "--seed -1 is out of range; give a whole number from 0 to 4294967295"),
        ("budget_ms", "x", "--budget-ms 'x' is not a number"),
        ("budget_ms", [1.0, 2.0], "is not a number"),
    ],
)
def test_what_is_out_of_bounds_is_bad_input(name: str, value: Any, told: str) -> None:
    with pytest.raises(BadInput) as error:
        gibench.run(technique="direct", out="/nowhere/at/all", **{name: value})
    assert told in str(error.value) and "\n" not in str(error.value)


def test_numpys_numbers_are_taken_and_are_pythons_afterwards() -> None:
    @within_bounds
    def command(receivers: Any = None, seed: int = 0, budget_ms: Any = None, **more: Any) -> Any:
        return receivers, seed, budget_ms

    numpys = command(np.int64(400), seed=np.uint8(3), budget_ms=np.float32(2.5))
    assert numpys == (400, 3, 2.5)
    assert [type(value) for value in numpys] == [int, int, float]
    several = command(np.array([1, 2]), budget_ms=7)
    assert several == ((1, 2), 0, 7) and type(several[0][0]) is int
    assert command() == (None, 0, None)


@pytest.mark.parametrize("name", ["receivers", "workgroup_size", "sh_order"])
def test_a_numpy_number_stands_for_itself_in_a_run(name: str) -> None:
    with pytest.raises(BadInput, match="no technique called 'nosuch'"):
        gibench.run(technique="nosuch", out="/nowhere/at/all", **{name: np.int64(64)})
