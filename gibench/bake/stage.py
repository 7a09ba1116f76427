"""Stages of a bake: what each is made of, what it needs, and the key that it is kept under.

A bake is a list of stages. A stage is one piece of work, or is made of units that do not need each
other; it may need earlier stages. Nothing here knows a technique: a technique owns its stages, with
keys and versions of their own, so that a change to one makes nothing else anew.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.work import Worker

Arrays = dict[str, npt.NDArray[Any]]


class Keep(Enum):
    """How long what a stage computes is kept in the store."""

    ALWAYS = "always"
    WHILE_NEEDED = "while needed"
    """Until the bake is done: large, and of no use afterwards."""
    NEVER = "never"
    """Sooner computed than read."""


@dataclass(frozen=True)
class Unit:
    """A piece of a stage that one worker computes.

    Attributes:
        name: unique in the stage; names its file.
        index: of the unit in the stage.
        data: what it is computed from, beside what all units of the stage are given; plain data.
        size: steps that it advances the progress by.
    """

    name: str
    index: int = 0
    data: Any = field(default=None, repr=False)
    size: int = 1


@dataclass(frozen=True)
class Format:
    """How what a unit computes is stored. Both are functions of a module.

    Attributes:
        write: from a value to arrays.
        read: from a unit and its stored arrays to the value; None where they are another unit's.
    """

    write: Callable[[Any], Arrays]
    read: Callable[[Unit, Arrays], Any | None]


Compute = Callable[[Any, Sequence[Any], Unit, Worker], Any]


@dataclass(frozen=True)
class Stage:
    """A stage of a bake: plain data and functions of modules, so that it can be sent anywhere.

    Attributes:
        name: in folders and messages; unique among all techniques'.
        key: of everything that what it computes depends on (:func:`stage_key`).
        compute: from ``given``, the values of ``needs`` in order, the unit and the worker to the
            unit's value.
        given: plain data that all units need.
        needs: stages whose values it takes; looked at only where a unit has to be computed.
        units: its units; None where it is one piece.
        format: how it is stored; None where ``keep`` is NEVER.
        keep: how long it is stored.
        title: of its progress; None where ``compute`` shows its own.
        made_from: what the key stands for, for people to read.
    """

    name: str
    key: str
    compute: Compute
    given: Any = field(repr=False)
    needs: tuple[Stage, ...] = field(default=(), repr=False)
    units: tuple[Unit, ...] | None = field(default=None, repr=False)
    format: Format | None = None
    keep: Keep = Keep.ALWAYS
    title: str | None = None
    made_from: tuple[tuple[str, Any], ...] = ()

    def __post_init__(self) -> None:
        if (self.format is None) != (self.keep is Keep.NEVER):
            raise ValueError(f"stage {self.name}: what is kept has a format, and nothing else")

    @property
    def pieces(self) -> tuple[Unit, ...]:
        """Its units; a stage of one piece has one, of the stage's name."""
        return (Unit(self.name),) if self.units is None else self.units

    def value(self, values: Sequence[Any]) -> Any:
        """The stage's value from its pieces': a tuple of theirs, or that of its only piece."""
        return values[0] if self.units is None else tuple(values)


def stage_key(name: str, version: int, *parts: object, needs: Sequence[Stage] = ()) -> str:
    """SHA-256 of all that a stage depends on, hexadecimal.

    Args:
        name: of the stage.
        version: raised whenever what the stage computes, or how it is stored, changes.
        parts: arrays, and anything whose ``repr`` says all.
        needs: the stages it needs: their keys are part of its own.
    """
    digest = hashlib.sha256(f"{name} {version}".encode() + b"\0")
    for part in (*parts, *(stage.key for stage in needs)):
        if isinstance(part, np.ndarray):
            digest.update(f"{part.dtype.str} {part.shape}".encode() + b"\0")
            digest.update(np.ascontiguousarray(part).tobytes() + b"\0")
        else:
            digest.update(repr(part).encode() + b"\0")
    return digest.hexdigest()
