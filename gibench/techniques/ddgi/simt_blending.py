"""The tuned blending in the layout ``simt``: neighbouring work-items on neighbouring addresses."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from gibench.device import Argument, Launch, ProgramSpec, local
from gibench.techniques.ddgi.blending import LIST_STEP, Tuned
from gibench.techniques.ddgi.probes import Probes

_GROUP: Final = 64
"""Work-items that make a texel's list or count rays on backs: a multiple of every SIMD width there
is."""
_LISTED: Final = 512
"""Rays at a time as lists are made, at most: 8 KB of local memory."""
_TEXELS: Final = 8
"""Texels of a group, so that a map is written in pieces of 32 bytes and more."""


class Simt(Tuned):
    """The products of :class:`Tuned` by groups of probes and texels that change places before they
    write (kernels_cl/ddgi/simt_blend.cl); the rays on backs are counted by its kernel.

    Args:
        probes: what is blended into.
        workgroup_size: work-items of a group at most.
    """

    def __init__(self, probes: Probes, workgroup_size: int) -> None:
        super().__init__(probes)
        self._team = min(self.lanes, workgroup_size)
        self._listed = min(probes.settings.blended, _LISTED)
        self._group = min(_GROUP, probes.device.profile.max_workgroup_size)
        together = probes.device.lanes_together
        self._vector = min(self._group, together) if together > 1 else 0

    def _weights(self, name: str, side: int, sharp: bool, least: float) -> Launch:
        launch = super()._weights(name, side, sharp, least)
        return replace(
            launch,
            program=self._simt_program(),
            args=(
                *launch.args,
                self._local("staged", 12 * self._listed),
                self._local("cosines", 4 * self._listed),
                self._local("counted", 4 * self._group),
            ),
            items=None,
            groups=-(-(side**2) // max(self._vector, 1)),
            workgroup_size=self._group,
        )

    def _backface_counts(self) -> Launch:
        return replace(super()._backface_counts(), workgroup_size=self._group)

    def _product(self, kernel: str, args: tuple[Argument, ...], side: int) -> Launch:
        probe_blocks = -(-self.probes.volume.probes // self.lanes)
        sums = self._local("sums", 3 * 4 * _TEXELS * (self.lanes + 32 // _TEXELS))  # of SUM_ROW
        return Launch(
            self._simt_program(),
            kernel,
            (*args, sums),
            workgroup_size=self._team,
            groups=probe_blocks * -(-(side**2) // _TEXELS),
        )

    def _local(self, name: str, nbytes: int) -> Argument:
        """Local memory, next to none where work-items exchange nothing."""
        return local(name, 4 if self._vector else nbytes)

    def _simt_program(self) -> ProgramSpec:
        defines = {
            **self.probes.defines(self.lanes),
            "TEXELS": _TEXELS,
            "TEAM": self._team,
            "LISTED": self._listed,
            "VECTOR": self._vector,
            "LIST_STEP": LIST_STEP,
        }
        return ProgramSpec("ddgi/simt_blend.cl", defines)
