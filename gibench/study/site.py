"""Where a study's jobs run: plain data, and the live things it stands for in a process."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from gibench.device.selection import select_cl_device
from gibench.files import write_whole
from gibench.measure.session.shared import Shared
from gibench.scene.model import Scene
from gibench.study.frozen import FrozenShared
from gibench.study.switched import LightSwitch, SwitchedShared
from gibench.work import Executor
from gibench.work.cluster_worker import local_folder
from gibench.work.worker import Resources

T = TypeVar("T")
S = TypeVar("S", bound=Shared)


@dataclass(frozen=True)
class Site:
    """Where jobs run. It pickles: what is live stays behind, and another process makes its own.

    Attributes:
        cache_dir: folder of bakes and references.
        seed: of every random choice.
        device: number of the OpenCL device; None for the first.
        executor: of bakes and truths; None for a thread per core.
        scenes: loaded, by the names that jobs have for them: of a site that travels.
        files: of its cache folder, by name: of a site that travels to where that is not seen.
        names: of scene files that share a name with another (``gibench.scene.load.names_apart``).
    """

    cache_dir: Path
    seed: int = 0
    device: int | None = None
    executor: Executor | None = None
    scenes: Mapping[str, Scene] = field(default_factory=dict, repr=False)
    files: Mapping[str, npt.NDArray[np.uint8]] = field(default_factory=dict, repr=False)
    names: Mapping[str, str] = field(default_factory=dict, repr=False)
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
        return self.kept("moving", partial(self._with_scenes, Shared))

    def standing(self, light_frame: int = 0) -> FrozenShared:
        """Scenes with the lights of one frame for ever, for errors."""
        made = partial(self._with_scenes, FrozenShared, light_frame=light_frame)
        return self.kept(("standing", light_frame), made)

    def switched(self, switch: LightSwitch) -> SwitchedShared:
        """Scenes whose lights change once."""
        return self.kept(switch, partial(self._with_scenes, SwitchedShared, switch=switch))

    def kept(self, key: Hashable, make: Callable[[], T]) -> T:
        """What this process keeps as ``key``, made by the first that asks."""
        return self._here.get(key, make)

    def _with_scenes(self, make: Callable[..., S], **more: Any) -> S:
        shared = make(self.cache_dir, self.seed, self.executor, self.names, **more)
        for name, scene in self.scenes.items():
            shared.hold(name, scene)
        return shared

    def __reduce__(self) -> tuple[Any, ...]:
        given = self.cache_dir, self.seed, self.device, self.executor
        if self.scenes:  # which have their names
            return _arrived, (*given, self.scenes, self.files)
        return Site, (*given, {}, {}, self.names)


def _arrived(
    cache_dir: Path,
    seed: int,
    device: int | None,
    executor: Executor | None,
    scenes: Mapping[str, Scene],
    files: Mapping[str, npt.NDArray[np.uint8]],
) -> Site:
    """The site where it came to: with a cache folder of the worker's own, and in it what came."""
    cache = local_folder()
    for name, content in files.items():
        path = cache / name
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, content.tobytes())
    return Site(cache, seed, device, executor, scenes)
