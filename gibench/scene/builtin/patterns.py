"""Small procedural textures."""

from __future__ import annotations

import numpy as np

from gibench.arrays import Doubles, Vec3
from gibench.errors import BadInput
from gibench.scene.model import Texture

SIZE = 128


def pattern(name: str, kind: str, colors: list[Vec3]) -> Texture:
    """A texture of ``kind`` for the material ``name``.

    Kinds: ``tiles`` (a chequer of the first two colours, joints of the third), ``bricks`` (courses
    of the first colour, each a little different, joints of the second), ``stripes`` (upright bands
    of the first two, a hem of the third along the lower edge).

    Raises:
        BadInput: no such kind.
    """
    y, x = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    shade = np.array(colors, np.float64)
    if kind == "tiles":
        image = _tiles(x, y, shade)
    elif kind == "bricks":
        image = _bricks(x, y, shade)
    elif kind == "stripes":
        image = np.where(((x * 8) % 1 < 0.5)[..., None], shade[0], shade[1])
        # Row 0 is the top (v = 1); the hem lies at v below 0.08.
        image = np.where((y > 0.92)[..., None], shade[2], image)
    else:
        raise BadInput(f"no pattern '{kind}'", where=name, mend="use tiles, bricks or stripes")
    return Texture(name, image.astype(np.float32))


def _tiles(x: Doubles, y: Doubles, shade: Doubles) -> Doubles:
    dark = (np.floor(x * 2) + np.floor(y * 2)) % 2 == 0
    joint = ((x * 2) % 1 < 0.03) | ((y * 2) % 1 < 0.03)
    image = np.where(dark[..., None], shade[0], shade[1])
    return np.asarray(np.where(joint[..., None], shade[2], image))


def _bricks(x: Doubles, y: Doubles, shade: Doubles) -> Doubles:
    course = np.floor(y * 8)
    along = x * 4 + 0.5 * (course % 2)
    # A fixed scramble of course and brick number gives each brick its own tone.
    tone = 0.85 + 0.3 * ((np.floor(along) % 4 * 7 + course * 5) % 11) / 10
    image = np.clip(shade[0] * tone[..., None], 0.02, 0.9)
    joint = (along % 1 < 0.04) | ((y * 8) % 1 < 0.08)
    return np.asarray(np.where(joint[..., None], shade[1], image))
