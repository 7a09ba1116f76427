"""What MTL files say of materials that is not read here."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from gibench.scene.gloss import DIELECTRIC_F0
from gibench.scene.readers.content import counted
from gibench.scene.readers.mtl_maps import numbers_of

_READ = {
    "kd", "ke", "d", "tr", "illum", "pr", "pm", "norm", "bump",
    *(f"map_{name}" for name in ("kd", "ke", "d", "bump", "pr", "pm")),
}  # fmt: skip
# Of highlights' shape, of an ambient light that there is none of, of the colour of what passes
# through glass, which is either opaque here or not there, and of image filters.
_NO_EFFECT = {
    "ka", "map_ka", "ns", "map_ns", "ni", "tf", "sharpness", "map_aat", "pcr", "map_pcr",
    "aniso", "anisor",
}  # fmt: skip
# Layers that count where one of their numbers is over 0: sheen and clearcoat.
_LAYERS = {"ps", "pc"}
# Illumination models without highlights, and those of mirrors (MTL format, illum).
_WITHOUT_HIGHLIGHTS = ("0", "1")
_MIRRORS = ("3", "5", "8")
_SPELLED = {
    "ks": "Ks", "map_ks": "map_Ks", "ps": "Ps", "pc": "Pc", "map_ps": "map_Ps", "map_pc": "map_Pc",
    "map_tr": "map_Tr",
}  # fmt: skip
_MOST = 8


def unread(values: Mapping[str, str]) -> list[str]:
    """The statements of a material that are not read and would change its light.

    Args:
        values: arguments by lower case keyword.
    """
    found = []
    illum = values.get("illum", "")
    for keyword, text in values.items():
        numbers = numbers_of(text)
        if keyword in _READ or keyword in _NO_EFFECT:
            continue
        if keyword in ("ks", "map_ks") and illum in _WITHOUT_HIGHLIGHTS:
            continue
        # Less than a dielectric mirrors straight ahead is no gloss that anyone has asked for.
        if keyword == "ks" and ("pr" in values or max(numbers, default=0.0) <= DIELECTRIC_F0):
            continue
        if keyword in _LAYERS and max(numbers, default=0.0) <= 0:
            continue
        found.append(_SPELLED.get(keyword, keyword[:24]))
    if illum in _MIRRORS:
        found.append(f"illum {illum}")
    return found


def said(found: Counter[str]) -> list[str]:
    """The one line that tells of them, by how many materials have each, or nothing."""
    if not found:
        return []
    told = [f"{what} of {counted(count, 'material')}" for what, count in found.most_common(_MOST)]
    more = [f"{len(found) - _MOST} more"] if len(found) > _MOST else []
    return [
        f"statements of materials not read ({', '.join(told + more)}): as if they were not there, "
        "surfaces are diffuse"
    ]
