"""The tuned blending in the layout ``simt``: neighbouring work-items on neighbouring addresses."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from gibench.device import Argument, Launch, ProgramSpec, local
from gibench.techniques.ddgi.blending import Tuned
from gibench.techniques.ddgi.probes import Probes

_WEIGHTS_GROUP: Final = 64
"""Work-items that make a texel's list: a multiple of every SIMD width there is."""
_TEXELS: Final = 8
"""Texels of a group at most, so that a map is written in pieces of 32 bytes and more."""


class Simt(Tuned):
    """The products of :class:`Tuned` by groups of probes and texels that change places before they
    write (kernels_cl/ddgi/simt_blend.cl); the rays on backs are counted by its kernel.

    Args:
        probes: what is blended into.
    """

    def __init__(self, probes: Probes) -> None:
        super().__init__(probes)
        most = probes.device.profile.max_workgroup_size
        self._texels = max(1, min(_TEXELS, most // self.lanes))

    def _weights(self, name: str, side: int, sharp: bool, least: float) -> Launch:
        launch = super()._weights(name, side, sharp, least)
        size = min(_WEIGHTS_GROUP, self.probes.device.profile.max_workgroup_size)
        return replace(
            launch,
            program=self._simt_program(),
            args=(*launch.args, local("staged", 12 * size), local("partial", 8 * size)),
            items=None,
            groups=side**2,
            workgroup_size=size,
        )

    def _product(self, kernel: str, args: tuple[Argument, ...], side: int) -> Launch:
        probe_blocks = -(-self.probes.volume.probes // self.lanes)
        row = self.lanes + 32 // self._texels  # SUM_ROW
        sums = local("sums", 3 * 4 * self._texels * row)
        return Launch(
            self._simt_program(),
            kernel,
            (*args, sums),
            groups=probe_blocks * -(-(side**2) // self._texels),
            workgroup_size=self.lanes * self._texels,
        )

    def _simt_program(self) -> ProgramSpec:
        defines = {**self.probes.defines(self.lanes), "TEXELS": self._texels}
        return ProgramSpec("ddgi/simt_blend.cl", defines)
