"""A user's own kernel as something to trace: its arguments from texts."""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.device import Define, Device, Parameter, Program, ProgramSpec, build_program
from gibench.errors import BadInput
from gibench.trace.request import TracedArgument, TraceRequest

_LARGEST = 2 << 30
"""Bytes of a buffer that is made up: each traced launch has copies of its buffers."""
_TYPES: dict[str, type[np.generic]] = {
    "char": np.int8,
    "uchar": np.uint8,
    "short": np.int16,
    "ushort": np.uint16,
    "int": np.int32,
    "uint": np.uint32,
    "long": np.int64,
    "ulong": np.uint64,
    "float": np.float32,
    "double": np.float64,
    "half": np.float16,
    "size_t": np.uint64,
    "unsigned int": np.uint32,
    "bool": np.bool_,
}


@dataclass(frozen=True)
class Extent:
    """How many work-items a kernel is launched on.

    Attributes:
        group: of a work-group, along one to three dimensions.
        items: of the launch along as many, whole groups; empty: as many along the first as the
            largest buffer has elements, rounded up to whole groups.
    """

    group: tuple[int, ...]
    items: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Give both as many dimensions, those that are not named of one item.

        Raises:
            BadInput: the group has several dimensions and the items are not given, or are no
                multiple of it.
        """
        group, items = self.group, self.items
        if not items and len(group) > 1:
            raise BadInput(
                f"--group {_by(group)} needs the launch's size, too",
                mend=f"add for instance --items {_by([16 * each for each in group])}",
            )
        count = max(len(group), len(items))
        group = (*group, *[1] * (count - len(group)))
        items = (*items, *[1] * (count - len(items))) if items else ()
        if any(whole % part for whole, part in zip(items, group, strict=False)):
            whole = [-(-each // part) * part for each, part in zip(items, group, strict=True)]
            raise BadInput(
                f"--items {_by(items)} is no multiple of the work-group size {_by(group)}",
                mend=f"give --items {_by(whole)}, or another size with -w or --group",
            )
        object.__setattr__(self, "group", group)
        object.__setattr__(self, "items", items)

    def groups(self, largest: int) -> tuple[int, ...]:
        """Groups of the launch along every dimension, ``largest`` elements being the most that a
        buffer has.
        """
        if not self.items:
            return (-(-largest // self.group[0]),)
        return tuple(whole // part for whole, part in zip(self.items, self.group, strict=True))


def sides_of(text: str, option: str) -> tuple[int, ...]:
    """Sizes along one to three dimensions, as in ``16x16``.

    Raises:
        BadInput: it is none.
    """
    parts = text.lower().split("x")
    if len(parts) > 3 or not all(re.fullmatch(r"[1-9]\d{0,9}", part) for part in parts):
        raise BadInput(f"{option} '{text}' is no size", mend=f"give for instance {option} 16x16")
    return tuple(map(int, parts))


def defines_of(texts: Sequence[str]) -> dict[str, Define]:
    """Macros from ``NAME=VALUE`` or, for 1, ``NAME``.

    Raises:
        BadInput: one is none, or is given twice.
    """
    found: dict[str, Define] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not re.fullmatch(r"[A-Za-z_]\w*", name) or (equals and not value):
            raise BadInput(
                f"--define '{text}' is not NAME=VALUE", mend="give for instance --define WIDTH=8"
            )
        if name in found:
            raise BadInput(f"--define {name} is given twice")
        found[name] = value if equals else 1
    return found


def _by(sides: Sequence[int]) -> str:
    return "x".join(map(str, sides))


def own_request(
    device: Device,
    file: Path,
    kernel: str,
    texts: Sequence[str],
    extent: Extent,
    defines: Mapping[str, Define] | None = None,
) -> TraceRequest:
    """The request for a kernel of a user's file.

    Args:
        device: builds it, for its parameters.
        file: OpenCL C.
        kernel: its name in it.
        texts: ``NAME=VALUE``: a number for a number; for a pointer a number of elements (random in
            [0, 1) where they are floats, zeros otherwise; of local memory only their room), or a
            ``.npy`` file with its content.
        extent: how many work-items it is launched on.
        defines: its macros.

    Raises:
        BadInput: the file cannot be read or built, has no such kernel, an argument is missing,
            unknown, of the wrong kind or out of range, or sizes do not go together.
    """
    import pyopencl as cl

    label, defines = f"{file.name}:{kernel}", defines or {}
    try:
        source = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"cannot be read as text ({error})", where=file) from error
    try:
        with _silent():
            built = build_program(device.context, source, defines)
        program = Program(ProgramSpec(file.name), source, built)
    except cl.Error as error:
        lines = [line.strip() for line in str(error).split("\n")]
        told = next((line for line in lines if line.startswith("error:")), lines[0])
        told = re.sub(r"\S*tempfile_\w+\.cl:", "line ", told.removeprefix("error: "))
        raise BadInput(f"does not build: {told}", where=file) from error
    if kernel not in program.kernel_names:
        has = ", ".join(program.kernel_names)
        raise BadInput(f"has no kernel '{kernel}'", where=file, mend=f"it has {has}")
    parameters = program.parameters(kernel, program.kernel(kernel)) or ()
    values: dict[str, str] = {}
    for name, value in map(_pair, texts):
        if name in values:
            raise BadInput(f"--arg {name} is given twice", where=label)
        values[name] = value
    if strangers := sorted(set(values) - {each.name for each in parameters}):
        names = ", ".join(each.name for each in parameters)
        raise BadInput(f"has no argument '{strangers[0]}'", where=label, mend=f"it has {names}")
    args = [_argument(each, values, label) for each in parameters]
    found = [a.data for a in args if isinstance(a.data, np.ndarray)]
    group = math.prod(extent.group)
    if group > device.profile.max_workgroup_size:
        raise BadInput(
            str(device.profile.workgroup_size_problem(group)),
            where=label,
            mend="give less with -w or --group",
        )
    largest = max((len(data) for data in found), default=group)
    sides = extent.group if len(extent.group) > 1 else ()
    return TraceRequest(source, defines, kernel, args, group, extent.groups(largest), label, sides)


@contextmanager
def _silent() -> Iterator[None]:
    """Nothing reaches the standard error stream: compilers count their errors there."""
    sys.stderr.flush()
    kept = os.dup(2)
    with Path(os.devnull).open("wb") as nothing:
        os.dup2(nothing.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _pair(text: str) -> tuple[str, str]:
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals and value):
        raise BadInput(
            f"--arg '{text}' is not NAME=VALUE",
            mend="give for instance --arg n=1024 or --arg values=values.npy",
        )
    return name, value


def _argument(parameter: Parameter, values: Mapping[str, str], label: str) -> TracedArgument:
    name = parameter.name
    kind, width = _element(parameter.type_name.rstrip("*"), label)
    if name not in values:
        what = "--arg {0}=ELEMENTS or {0}=FILE.npy" if parameter.is_pointer else "--arg {0}=NUMBER"
        raise BadInput(
            f"argument '{name}' ({parameter.type_name}) is not given",
            where=label,
            mend=f"add {what.format(name)}",
        )
    text = values[name]
    if parameter.is_pointer and text.endswith(".npy"):
        if parameter.is_local:
            raise BadInput(
                f"argument '{name}' is local memory, which no file fills",
                where=label,
                mend=f"give its number of elements, --arg {name}=ELEMENTS",
            )
        data = _loaded(Path(text), kind, width, parameter.type_name)
        return TracedArgument(name, data, 0, not parameter.constant)
    try:
        number = float(text) if kind.kind == "f" and not parameter.is_pointer else int(text)
    except ValueError as error:
        raise BadInput(f"--arg {name}={text} is no number", where=label) from error
    if not parameter.is_pointer:
        if width > 1:
            raise BadInput(f"arguments of type {parameter.type_name} cannot be given", where=label)
        return TracedArgument(name, _in_range(number, kind, f"--arg {name}={text}", label))
    count = int(number)
    if count < 1:
        raise BadInput(f"--arg {name}={text} is no number of elements", where=label)
    nbytes = count * width * kind.itemsize
    if nbytes > _LARGEST:
        raise BadInput(
            f"--arg {name}={text} is too large to trace: {nbytes / 1e9:,.1f} GB",
            where=label,
            mend=f"a buffer may have {_LARGEST // (width * kind.itemsize):,} elements",
        )
    if parameter.is_local:
        return TracedArgument(name, None, nbytes)
    shape = (count, width) if width > 1 else (count,)
    made: npt.NDArray[Any] = np.zeros(shape, kind)
    if kind.kind == "f":
        made = np.random.default_rng(0).random(shape).astype(kind)
    return TracedArgument(name, made, 0, not parameter.constant)


def _in_range(number: float, kind: np.dtype[Any], told: str, label: str) -> np.generic:
    """The number as the kernel's type has it.

    Raises:
        BadInput: the type cannot hold it.
    """
    low: float
    high: float
    if kind.kind == "f":
        low, high = float(np.finfo(kind).min), float(np.finfo(kind).max)
        holds = not math.isfinite(number) or low <= number <= high
    else:
        low, high = (0, 1) if kind.kind == "b" else (np.iinfo(kind).min, np.iinfo(kind).max)
        holds = low <= number <= high
    if not holds:
        raise BadInput(f"{told} is out of range", where=label, mend=f"give {low} to {high}")
    found: np.generic = kind.type(number)
    return found


def _element(name: str, label: str) -> tuple[np.dtype[Any], int]:
    """Type and number of components of an element."""
    match = re.fullmatch(r"([a-z_ ]+?)(2|3|4|8|16)?", name.strip())
    if match is None or match[1] not in _TYPES:
        raise BadInput(f"arguments of type {name} cannot be made up", where=label)
    width = int(match[2] or 1)
    return np.dtype(_TYPES[match[1]]), 4 if width == 3 else width


def _loaded(path: Path, kind: np.dtype[Any], width: int, type_name: str) -> npt.NDArray[Any]:
    """The content of a file for a buffer of elements of ``width`` numbers of ``kind``.

    Raises:
        BadInput: it cannot be read, is of another type, or holds no whole number of elements.
    """
    try:
        data: npt.NDArray[Any] = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise BadInput(f"cannot be read as an array ({error})", where=path) from error
    if data.dtype != kind:
        raise BadInput(
            f"holds {data.dtype}, and the kernel takes {type_name}: {kind}",
            where=path,
            mend=f"save it as numpy.{kind.name}",
        )
    if data.size == 0 or data.size % width:
        raise BadInput(
            f"holds {data.size:,} numbers, no whole number of elements of {width}", where=path
        )
    return np.ascontiguousarray(np.atleast_1d(data))
