"""Where a study's jobs run: plain data, and the live things it stands for in a process."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from gibench.device.device import select_cl_device
from gibench.measure.session.shared import Shared
from gibench.study.frozen import FrozenShared
from gibench.study.switched import LightSwitch, SwitchedShared
from gibench.work import Executor
from gibench.work.worker import Resources

T = TypeVar("T")


@dataclass(frozen=True)
class Site:
    """Where jobs run. It pickles: what is live stays behind, and another process makes its own.

    Attributes:
        cache_dir: folder of bakes and references.
        seed: of every random choice.
        device: number of the OpenCL device; None for the first.
        executor: of bakes; None for a thread per core.
    """

    cache_dir: Path
    seed: int = 0
    device: int | None = None
    executor: Executor | None = None
    _here: Resources = field(default_factory=Resources, repr=False, compare=False)

    @property
    def cl_device(self) -> Any:
        """The OpenCL device.

        Raises:
            BadInput: there is none of that number.
            CannotRun: there is none at all.
        """
        return self.kept("device", partial(select_cl_device, self.device))

    def moving(self) -> Shared:
        """Scenes as they are, for times."""
        return self.kept("moving", partial(Shared, self.cache_dir, self.seed, self.executor))

    def standing(self, light_frame: int = 0) -> FrozenShared:
        """Scenes with the lights of one frame for ever, for errors."""
        given = self.cache_dir, self.seed, self.executor
        made = partial(FrozenShared, *given, light_frame=light_frame)
        return self.kept(("standing", light_frame), made)

    def switched(self, switch: LightSwitch) -> SwitchedShared:
        """Scenes whose lights change once."""
        given = self.cache_dir, self.seed, self.executor
        return self.kept(switch, partial(SwitchedShared, *given, switch=switch))

    def kept(self, key: Hashable, make: Callable[[], T]) -> T:
        """What this process keeps as ``key``, made by the first that asks."""
        return self._here.get(key, make)

    def __reduce__(self) -> tuple[Any, ...]:
        return Site, (self.cache_dir, self.seed, self.device, self.executor)
