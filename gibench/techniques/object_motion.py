"""Which motion of the scene's objects a run follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gibench.errors import BadInput
from gibench.scene.builtin import moving_names
from gibench.scene.colours import Change
from gibench.scene.model import Scene
from gibench.scene.motion.file import load_motions, motions_hash
from gibench.scene.motion.moving_objects import MovingObjects
from gibench.scene.readers.recentre import motions_from_file

REST: Final = "rest"
SCENE: Final = "scene"


@dataclass(frozen=True)
class MotionOptions:
    """Whether a run's objects move: the same for every technique.

    Attributes:
        path: ``rest``; ``scene``, as the scene describes; or a TOML file of ``[[motion]]`` tables.
        held: the frame in which all stands still, for its truth; None to let it move.
    """

    path: str = REST
    held: int | None = None

    @property
    def moves(self) -> bool:
        """Whether anything moves."""
        return self.path != REST

    def motions(self, scene: Scene) -> tuple[Change, ...]:
        """What moves in ``scene``; nothing at rest.

        Raises:
            BadInput: the scene describes no motion, or the file holds none.
        """
        if not self.moves:
            return ()
        if self.path != SCENE:
            return motions_from_file(load_motions(Path(self.path)), scene)
        if not scene.motions:
            raise BadInput(
                f"scene '{scene.name}' describes no motion",
                where="--motion",
                mend="give a TOML file with [[motion]] tables, or a scene that describes one: "
                + _or(moving_names()),
            )
        return scene.motions

    def record(self) -> dict[str, str | None]:
        """For a run's record: the path's base name, and a hash of the motions in a file."""
        hashed = None if self.path in (REST, SCENE) else motions_hash(load_motions(Path(self.path)))
        return {"path": Path(self.path).name, "motions_hash": hashed}

    def of(self, scene: Scene) -> MovingObjects | None:
        """What moves in ``scene``, bound to its objects; None at rest.

        Raises:
            BadInput: there is no such motion, or it does not fit the scene.
        """
        if not (motions := self.motions(scene)):
            return None
        try:
            return MovingObjects.of(scene, motions, self.held)
        except BadInput as error:
            where = "--motion" if self.path == SCENE else self.path
            raise BadInput(error.what, where=where, mend=error.mend) from error


def _or(names: Sequence[str]) -> str:
    return " or ".join(filter(None, (", ".join(names[:-1]), names[-1])))
