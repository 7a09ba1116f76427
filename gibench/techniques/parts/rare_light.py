"""Light that comes from so small a part of what can be seen that rays seldom find it."""

from __future__ import annotations

from typing import Final

from gibench.techniques.parts.free_space import FreeSpace

_MATTERS: Final = 0.1  # share of all light that must come from there
_HITS: Final = 10.0  # under which a mean of so many rays is a guess
NOISE: Final = "noise about the right mean"
OR_DARK: Final = f"{NOISE}, or dark"


def rare_light(
    space: FreeSpace, rays: float, who: str, mend: str, becomes: str = OR_DARK
) -> list[str]:
    """What of a scene's light a mean over ``rays`` directions of the sphere does not find.

    Args:
        space: of the scene.
        rays: that a mean holds.
        who: casts them, in words.
        mend: a setting that takes more, in words; empty where there is none.
        becomes: what the result then is, in words.
    """
    if space.light <= 0:
        return []
    kinds = (
        (space.emitted, space.small_emitters, "emitting surfaces", "give them as point lights"),
        (space.sky / 2, space.bright_sky, "the sky's brightest part",
         "give it as a directional light"),
    )  # fmt: skip
    told = []
    for light, share, what, instead in kinds:
        hits = share * rays
        if share > 0 and light > _MATTERS * space.light and hits < _HITS:
            told.append(
                f"{light / space.light:.0%} of the light comes from {what}, {share:.1g} of the "
                f"sphere: {hits:.2g} of {rays:,.0f} rays {who} meet them, and the result is "
                f"{becomes}; {instead}{mend}"
            )
    return told
