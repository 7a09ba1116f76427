"""What configurations share: scenes, lightmaps and bakes, each made once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.bake.lightmap import cached_lightmap
from gibench.scene.lightmap import Lightmap
from gibench.scene.model import Scene
from gibench.techniques.registry import BakeContext, TechniqueSpec
from gibench.work import Executor


@dataclass
class Shared:
    """Scenes, lightmaps and baked data of a run.

    Configurations come ordered by scene and receivers, so only the last lightmap and what was baked
    on it are kept in memory; the cache folder holds the others. Several threads may ask: what one
    is having made the others wait for.

    Attributes:
        cache_dir: where lightmaps and baked data are kept between runs.
        seed: of every random choice.
        executor: of bakes; a thread per core by default.
        names: of files that share a name with another (``gibench.scene.load.names_apart``).
    """

    cache_dir: Path
    seed: int
    executor: Executor | None = None
    names: Mapping[str, str] = field(default_factory=dict)
    _scenes: dict[str, Scene] = field(default_factory=dict, repr=False)
    _lightmap: tuple[tuple[str, int], Lightmap] | None = field(default=None, repr=False)
    _baked: dict[str, Any] = field(default_factory=dict, repr=False)
    _lock: RLock = field(default_factory=RLock, repr=False)

    def scene(self, name_or_path: str) -> Scene:
        """The scene.

        Raises:
            BadInput: there is none, or its files are unsound.
        """
        from gibench.scene.load import key_of, load_scene

        with self._lock:
            if name_or_path not in self._scenes:
                called = self.names.get(key_of(name_or_path)) if self.names else None
                self._scenes[name_or_path] = load_scene(name_or_path, called)
            return self._scenes[name_or_path]

    def hold(self, name_or_path: str, scene: Scene) -> None:
        """Take ``scene`` for what the name stands for; its files need not be here."""
        with self._lock:
            self._scenes[name_or_path] = scene

    def lightmap(self, name_or_path: str, receivers: int) -> Lightmap:
        """The scene's lightmap with about ``receivers`` receivers.

        Raises:
            BadInput: the scene cannot be unwrapped.
        """
        key = (name_or_path, receivers)
        with self._lock:
            if self._lightmap is None or self._lightmap[0] != key:
                self._baked.clear()
                self._lightmap = None
                scene = self.scene(name_or_path)
                self._lightmap = key, cached_lightmap(scene, receivers, self.cache_dir)
            return self._lightmap[1]

    def baked(
        self,
        spec: TechniqueSpec,
        settings: Any,
        name_or_path: str,
        receivers: int,
        moving: npt.NDArray[np.bool_] | None = None,
    ) -> tuple[Lightmap, Any]:
        """The lightmap and what ``spec`` bakes on it, where the triangles ``moving`` (t,) move.

        Raises:
            GibenchError: it cannot be baked.
        """
        with self._lock:
            lightmap = self.lightmap(name_or_path, receivers)
            scene = self.scene(name_or_path)
            context = self.context(settings, scene, lightmap, moving)
            # The same as on the disk: settings that bake the same share it in memory, too.
            key = spec.bake_key(context)
            if key not in self._baked:
                self._baked[key] = spec.bake(context, self.executor)
            return lightmap, self._baked[key]

    def context(
        self,
        settings: Any,
        scene: Scene,
        lightmap: Lightmap,
        moving: npt.NDArray[np.bool_] | None = None,
    ) -> BakeContext:
        """What a bake of ``scene`` on ``lightmap`` is made from."""
        return BakeContext(scene, lightmap, settings, self.cache_dir, self.seed, moving)

    def bake_seconds(
        self,
        spec: TechniqueSpec,
        settings: Any,
        scene: Scene,
        lightmap: Lightmap,
        moving: npt.NDArray[np.bool_] | None = None,
    ) -> float:
        """Wall time, s, that baking for ``spec`` on ``lightmap`` has taken, whenever that was."""
        return spec.bake_seconds(self.context(settings, scene, lightmap, moving))
