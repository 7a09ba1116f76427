"""A program as data, and built: its kernels, their parameters, what they ask of their group."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import pyopencl as cl

from gibench.device.build import Define
from gibench.errors import GibenchError


@dataclass(frozen=True)
class Instrument:
    """A build of the same kernels that says what they do: a macro with which the shared headers
    (``kernels_cl/common``) give the kernels one more parameter, a buffer of counters.

    Attributes:
        name: of the instrument.
        macro: defined as 1 in the build.
        parameter: the parameter's name.
        after: the parameter that it stands behind; kernels without that one cannot be instrumented.
        words: its length, uint32, zero before a launch.
    """

    name: str
    macro: str
    parameter: str
    after: str
    words: int


COUNT_RAYS = Instrument("count_rays", "RAY_COUNTS", "ray_counts", "bvh_triangles", 2)
"""Counts the closest-hit and the any-hit rays of a launch (kernels_cl/common/bvh.cl)."""

INSTRUMENTS = {item.name: item for item in (COUNT_RAYS,)}


def find_instrument(name: str) -> Instrument:
    """The instrument called ``name``.

    Raises:
        GibenchError: there is none.
    """
    if name not in INSTRUMENTS:
        raise GibenchError(f"no instrument is called '{name}'; there is {', '.join(INSTRUMENTS)}")
    return INSTRUMENTS[name]


@dataclass(frozen=True)
class ProgramSpec:
    """A program before it is built.

    Attributes:
        path: file beneath ``kernels_cl``.
        defines: its macros.
    """

    path: str
    defines: Mapping[str, Define] = field(default_factory=dict)


@dataclass(frozen=True)
class Parameter:
    """A parameter of a kernel, as the driver knows it.

    Attributes:
        name: in the kernel's source.
        type_name: as in the source, without qualifiers: ``float*``, ``int``.
        constant: whether what it points at cannot be written.
        is_local: whether it points at local memory.
    """

    name: str
    type_name: str
    constant: bool
    is_local: bool

    @property
    def is_pointer(self) -> bool:
        """Whether it takes a buffer or local memory."""
        return self.type_name.endswith("*")


# What a kernel's body says where its result depends on how items fall into groups.
_GROUP_WORDS = ("__local", "barrier(", "get_local_", "get_group_id", "get_num_groups")


@dataclass
class Program:
    """A built program.

    Attributes:
        spec: what it was built from.
        source: its source, includes expanded.
        built: the ``pyopencl.Program``.
    """

    spec: ProgramSpec
    source: str = field(repr=False)
    built: Any = field(repr=False)
    _parameters: dict[str, tuple[Parameter, ...] | None] = field(default_factory=dict, repr=False)

    @property
    def defines(self) -> Mapping[str, Define]:
        """Its macros."""
        return self.spec.defines

    @cached_property
    def kernel_names(self) -> tuple[str, ...]:
        """The kernels in it."""
        return tuple(str(self.built.kernel_names).split(";"))

    def kernel(self, name: str) -> Any:
        """A new ``pyopencl.Kernel`` called ``name``, with arguments of its own.

        Raises:
            GibenchError: the program has no such kernel.
        """
        try:
            return cl.Kernel(self.built, name)
        except cl.Error as error:
            raise GibenchError(f"the program has no kernel '{name}' ({error})") from error

    def parameters(self, name: str, kernel: Any) -> tuple[Parameter, ...] | None:
        """The parameters of the kernel ``name``, asked once; None where the driver does not tell.

        Args:
            name: of the kernel.
            kernel: any kernel object of that name.
        """
        if name not in self._parameters:
            self._parameters[name] = _parameters_of(kernel)
        return self._parameters[name]

    def asks_for_its_group(self, name: str) -> bool:
        """Whether the kernel's body uses local memory, barriers or its place in a group, so that
        not every work-group size suits it; also where its body cannot be found.
        """
        start = self.source.find(f"void {name}(")
        body = self.source[start : self.source.find("\n}", start)]
        return start < 0 or any(word in body for word in _GROUP_WORDS)


def _parameters_of(kernel: Any) -> tuple[Parameter, ...] | None:
    info = cl.kernel_arg_info
    constant, local = cl.kernel_arg_type_qualifier.CONST, cl.kernel_arg_address_qualifier.LOCAL
    try:
        return tuple(
            Parameter(
                name=kernel.get_arg_info(i, info.NAME),
                type_name=kernel.get_arg_info(i, info.TYPE_NAME),
                constant=bool(kernel.get_arg_info(i, info.TYPE_QUALIFIER) & constant),
                is_local=kernel.get_arg_info(i, info.ADDRESS_QUALIFIER) == local,
            )
            for i in range(kernel.num_args)
        )
    except cl.Error:  # CL_KERNEL_ARG_INFO_NOT_AVAILABLE: a driver may refuse
        return None
