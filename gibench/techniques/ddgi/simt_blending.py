"""The tuned blending in the layout ``simt``: neighbouring work-items on neighbouring addresses."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from gibench.device import Argument, Launch, ProgramSpec, local
from gibench.techniques.ddgi.blending import Tuned
from gibench.techniques.ddgi.probes import Probes

_WEIGHTS_GROUP: Final = 64
"""Work-items that make a texel's list: a multiple of every SIMD width there is."""
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

    def _weights(self, name: str, side: int, sharp: bool, least: float) -> Launch:
        launch = super()._weights(name, side, sharp, least)
        size = min(_WEIGHTS_GROUP, self.probes.device.profile.max_workgroup_size)
        return replace(
            launch,
            program=self._simt_program(),
            args=(
                *launch.args,
                local("staged", 12 * self._listed),
                local("cosines", 4 * self._listed),
                local("counted", 4 * size),
            ),
            items=None,
            groups=side**2,
            workgroup_size=size,
        )

    def _product(self, kernel: str, args: tuple[Argument, ...], side: int) -> Launch:
        probe_blocks = -(-self.probes.volume.probes // self.lanes)
        sums = local("sums", 3 * 4 * _TEXELS * (self.lanes + 32 // _TEXELS))  # of SUM_ROW
        return Launch(
            self._simt_program(),
            kernel,
            (*args, sums),
            workgroup_size=self._team,
            groups=probe_blocks * -(-(side**2) // _TEXELS),
        )

    def _simt_program(self) -> ProgramSpec:
        defines = {
            **self.probes.defines(self.lanes),
            "TEXELS": _TEXELS,
            "TEAM": self._team,
            "LISTED": self._listed,
        }
        return ProgramSpec("ddgi/simt_blend.cl", defines)
