"""Materials of OBJ files (Wavefront, MTL format; Pr, Pm, Ke, norm: Exocortex's PBR extension).

Kd is the albedo, times map_Kd; Ke is emitted radiance, times map_Ke; d (or 1 - Tr) is opacity.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from gibench.arrays import Array, Vec3
from gibench.errors import BadInput
from gibench.scene.files import find_near, read_bytes
from gibench.scene.model import BLACK, Material, Texture
from gibench.scene.readers.content import Maps, counted, vec3
from gibench.scene.readers.float_images import UnreadableImage
from gibench.scene.readers.mtl_files import library_files
from gibench.scene.readers.mtl_maps import MapStatement, Transform, map_statement, numbers_of
from gibench.scene.readers.mtl_unread import said, unread
from gibench.scene.readers.text import argument, read_text, statements, without_comment
from gibench.scene.readers.textures import (
    bumps_from_bytes,
    channel_from_bytes,
    gloss_of,
    grey_from_bytes,
    normals_from_bytes,
    opacity_from_bytes,
    radiance_from_bytes,
    texture_from_bytes,
)

# Kd of a face without a material, or of a material that names none. The MTL specification gives
# no default; 0.8 is Material's own.
DEFAULT_COLOR: Vec3 = Material("default").base_color
WHITE: Vec3 = (1.0, 1.0, 1.0)

_NORMAL_MAPS = ("norm", "map_bump", "bump")
NORMAL_MAP = "normal map"
"""The keyword that coordinates of normal maps are asked for by, whichever statement named one."""

# Illumination models of glass (MTL format: 4, 6, 7 and 9), which say nothing of how much passes.
_GLASS = ("4", "6", "7", "9")
_GLOSS_MAPS = ("map_pr", "map_pm")
# What there is instead of an image that is missing, by the statement that named it.
_INSTEAD = {
    "map_kd": "plain colours",
    "map_ke": "plain colours",
    "map_d": "the material's own opacity",
    **dict.fromkeys(_NORMAL_MAPS, "the geometric normal"),
    **dict.fromkeys(_GLOSS_MAPS, "the material's own numbers"),
}
GLOSS_MAP = "gloss map"
"""Likewise of roughness and metalness, of which one image is made."""

Decoder = Callable[[str, bytes], Texture]


@dataclass
class _Entries:
    """The statements of one material: argument by lower case keyword, and the file."""

    file: Path
    values: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Library:
    """The materials of an OBJ file.

    Attributes:
        materials: those that are used.
        maps: of each of them.
        textures: what they refer to.
        warnings: what was missing or not used.
        numbers: of a material by the name in ``usemtl``.
        transforms: of texture coordinates by material and keyword, where there are any.
    """

    materials: tuple[Material, ...]
    maps: tuple[Maps, ...]
    textures: tuple[Texture, ...]
    warnings: tuple[str, ...]
    numbers: dict[str, int]
    transforms: dict[tuple[int, str], Transform]

    def uvs_of(self, material: int, keyword: str, uvs: Array | None) -> Array | None:
        """The coordinates (v, 2) at which a map of the material is looked up."""
        if uvs is None or (material, keyword) not in self.transforms:
            return uvs
        scale, offset = self.transforms[material, keyword]
        return np.asarray(uvs * scale + np.asarray(offset))


def read_libraries(folder: Path, named: list[str], used: list[str], has_colors: bool) -> Library:
    """The materials of an OBJ file.

    Args:
        folder: of the OBJ file.
        named: what follows each ``mtllib``.
        used: what follows each ``usemtl`` before a face; "" for none.
        has_colors: whether vertices have colours, which are the albedo of undefined materials.
    """
    reader = _Reader(folder)
    for statement in dict.fromkeys(named):
        reader.read_statement(statement)
    return reader.library(list(dict.fromkeys(used)), WHITE if has_colors else DEFAULT_COLOR)


class _Reader:
    """The libraries of one OBJ file being read."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.found: dict[str, _Entries] = {}
        self.warnings: list[str] = []
        self.textures: dict[Path, Texture] = {}
        self.transforms: dict[tuple[int, str], Transform] = {}
        self.missing: dict[str, list[str]] = {}  # files, by what there is instead
        self.options: list[str] = []
        self.senseless: list[str] = []
        self.earlier: list[tuple[str, _Entries]] = []  # definitions that later ones replace
        self.glass: list[str] = []
        self.unread: Counter[str] = Counter()
        self.before_any = 0

    def read_statement(self, text: str) -> None:
        """All libraries that one ``mtllib`` names."""
        files, unknown = library_files(self.folder, text)
        for name in unknown:
            self.warnings.append(f"material file '{name}' not found: default colours used")
        for file in files:
            try:
                self._read(file)
            except BadInput as error:
                self.warnings.append(f"material file '{file.name}' is not used: {error.what}")

    def _read(self, file: Path) -> None:
        entries: _Entries | None = None
        for _, statement in statements(read_text(file, "an MTL text file")):
            keyword = statement.split(None, 1)[0].lower()
            if keyword == "newmtl":
                entries = _Entries(file)
                name = " ".join(argument(statement).split())
                if name in self.found:
                    self.earlier.append((name, self.found[name]))
                self.found[name] = entries
            elif entries is not None:
                entries.values[keyword] = argument(statement)
            else:
                self.before_any += 1

    def library(self, names: list[str], undefined: Vec3) -> Library:
        """The materials called ``names``."""
        by_short = {without_comment(name): entries for name, entries in self.found.items()}
        materials, maps = [], []
        unknown = []
        for number, name in enumerate(names):
            entries = self.found.get(name) or by_short.get(without_comment(name))
            if entries is None:
                unknown.append(name)
                materials.append(Material(name or "default", undefined))
                maps.append(Maps())
                continue
            material, images = self._material(name, number, entries)
            self.unread.update(unread(entries.values))
            materials.append(material)
            maps.append(images)
        self._remark(list(filter(None, unknown)))
        numbers = {name: i for i, name in enumerate(names)}
        return Library(
            materials=tuple(materials),
            maps=tuple(maps),
            textures=tuple(self.textures.values()),
            warnings=tuple(self.warnings),
            numbers=numbers,
            transforms=self.transforms,
        )

    def _remark(self, unknown: list[str]) -> None:
        if unknown:
            self.warnings.append(
                f"{counted(len(unknown), 'material')} not defined ({_some(unknown)}): default "
                "colours used"
            )
        for instead, files in self.missing.items():
            self.warnings.append(
                f"{counted(len(set(files)), 'texture')} missing or unreadable "
                f"({_some(files)}): {instead} used"
            )
        if self.options:
            self.warnings.append(f"options of texture maps not used: {_some(self.options)}")
        twice = [name for name, old in self.earlier if old.values != self.found[name].values]
        if twice:
            self.warnings.append(
                f"{counted(len(set(twice)), 'material')} defined more than once "
                f"({_some(twice)}): the last definition used"
            )
        if self.glass:
            self.warnings.append(
                f"{counted(len(self.glass), 'material')} of glass by illum alone "
                f"({_some(self.glass)}): opaque, as neither d nor Tr lets light through"
            )
        if self.before_any:
            told = counted(self.before_any, "statement")
            self.warnings.append(f"{told} of material files before any newmtl: not read")
        self.warnings += said(self.unread)
        if self.senseless:
            self.warnings.append(
                f"{counted(len(self.senseless), 'statement')} of materials not understood "
                f"({_some(self.senseless)}): defaults used"
            )

    def _material(self, name: str, number: int, entries: _Entries) -> tuple[Material, Maps]:
        texture, emission_map, opacity_map = -1, None, None
        image = self._image(entries, number, "map_kd")
        if image is not None:
            texture = self._texture(*image, "map_kd")
        glow = self._image(entries, number, "map_ke")
        if glow is not None:
            emission_map = self._decoded(*glow, "map_ke", radiance_from_bytes)
        cut_out = self._image(entries, number, "map_d")
        if cut_out is not None:
            channel = map_statement(entries.values["map_d"]).channel
            decode = partial(channel_from_bytes, channel=channel) if channel else opacity_from_bytes
            opacity_map = self._decoded(*cut_out, "map_d", decode)
        # With a texture but no Kd, the texture is the albedo; with Kd 0 the exporter has left it to
        # the texture as well. So for emission.
        color = self._color(entries, "kd", WHITE if texture >= 0 else DEFAULT_COLOR)
        if texture >= 0 and not any(color):
            color = WHITE
        if max(color) > 1:
            self.senseless.append(f"Kd {entries.values['kd']}, over 1")
        emission = self._color(entries, "ke", BLACK)
        if emission_map is not None and not any(emission):
            emission = WHITE
        opacity = self._opacity(entries)
        if entries.values.get("illum") in _GLASS and opacity == 1 and cut_out is None:
            self.glass.append(name or "default")
        bumps = self._normal_map(entries, number)
        gloss, maps = self._gloss(entries, name), self._gloss_map(entries, number)
        material = Material(
            name=name or "default",
            base_color=vec3(np.clip(color, 0.0, 1.0)),
            emission=emission,
            texture=texture,
            emission_map="" if emission_map is None else emission_map.name,
            alpha_mode="mask" if cut_out else "blend" if opacity < 1 else "opaque",
            opacity=opacity,
            opacity_map="" if opacity_map is None else opacity_map.name,
            roughness=gloss[0],
            metalness=gloss[1],
            roughness_map=self._name(entries, *_GLOSS_MAPS),
            normal_map=self._name(entries, *_NORMAL_MAPS),
        )
        return material, Maps(emission=emission_map, opacity=opacity_map, normal=bumps, gloss=maps)

    def _gloss(self, entries: _Entries, name: str) -> tuple[float, float]:
        """Roughness and metalness. Without a number, or with 0, an image is all there is, as with
        Kd.

        Raises:
            BadInput: a number that is not from 0 to 1.
        """
        found = []
        for keyword, image, default in (("pr", "map_pr", 1.0), ("pm", "map_pm", 0.0)):
            text = entries.values.get(keyword)
            for value in numbers_of(text or ""):
                if not 0 <= value <= 1:
                    raise BadInput(
                        f"material '{name}' has {keyword.capitalize()} {value:g}",
                        where=entries.file,
                        mend="it goes from 0 to 1",
                    )
            value = self._number(entries, keyword, default)
            found.append(value or (1.0 if entries.values.get(image) else 0.0))
        return found[0], found[1]

    def _gloss_map(self, entries: _Entries, number: int) -> Texture | None:
        """map_Pr and map_Pm as one image, at the larger's size; of two places in the image, that of
        map_Pr is taken.
        """
        images: list[Texture | None] = []
        transforms = []
        for keyword in _GLOSS_MAPS:
            image = self._image(entries, number, keyword)
            transforms.append(self.transforms.pop((number, keyword), None))
            images.append(
                None if image is None else self._decoded(*image, keyword, grey_from_bytes)
            )
        both = gloss_of(images[0], images[1])
        if both is None:
            return None
        if None not in images and transforms[0] != transforms[1]:
            self.options.append("-s, -o of map_Pm beside map_Pr")
        chosen = transforms[0] if images[0] is not None else transforms[1]
        if chosen is not None:
            self.transforms[number, GLOSS_MAP] = chosen
        return both

    def _normal_map(self, entries: _Entries, number: int) -> Texture | None:
        """``norm``, else ``map_bump`` or ``bump``; its coordinates are those of NORMAL_MAP."""
        for keyword in _NORMAL_MAPS:
            image = self._image(entries, number, keyword)
            if image is None:
                continue
            if transform := self.transforms.pop((number, keyword), None):
                self.transforms[number, NORMAL_MAP] = transform
            strength = map_statement(entries.values[keyword]).strength
            try:
                data = read_bytes(image[1])
                if keyword == "norm":
                    return normals_from_bytes(image[0], data)
                return bumps_from_bytes(image[0], data, strength)
            except (UnreadableImage, BadInput) as error:
                self.warnings.append(f"normal map '{image[0]}' is not used: {error}")
                return None
        return None

    def _image(self, entries: _Entries, number: int, keyword: str) -> tuple[str, Path] | None:
        """Name and file of a map, its coordinates' transform noted; None where there is none."""
        if not entries.values.get(keyword):
            return None
        statement = map_statement(entries.values[keyword])
        file = find_near((entries.file.parent, self.folder), statement.file)
        if file is None:
            self._misses(statement.file, keyword)
            return None
        if statement.transform != MapStatement("").transform:
            self.transforms[number, keyword] = statement.transform
        self.options += statement.ignored
        of_colors = keyword in ("map_kd", "map_ke")
        if statement.channel not in ("", "l") and not of_colors and keyword != "map_d":
            self.options.append(f"-imfchan {statement.channel}")
        return statement.file, file

    def _misses(self, name: str, keyword: str) -> None:
        self.missing.setdefault(_INSTEAD[keyword], []).append(name)

    def _texture(self, name: str, file: Path, keyword: str) -> int:
        if file not in self.textures:
            texture = self._decoded(name, file, keyword, texture_from_bytes)
            if texture is None:
                return -1
            self.textures[file] = texture
        return list(self.textures).index(file)

    def _decoded(self, name: str, file: Path, keyword: str, decode: Decoder) -> Texture | None:
        try:
            return decode(name, read_bytes(file))
        except (UnreadableImage, BadInput):
            self._misses(name, keyword)
            return None

    def _name(self, entries: _Entries, *keywords: str) -> str:
        for keyword in keywords:
            if entries.values.get(keyword):
                return map_statement(entries.values[keyword]).file
        return ""

    def _color(self, entries: _Entries, keyword: str, default: Vec3) -> Vec3:
        """A colour of one or three numbers; the default where there is none."""
        text = entries.values.get(keyword)
        if text is None:
            return default
        numbers = numbers_of(text)
        if len(numbers) == 1:
            numbers *= 3
        if len(numbers) < 3 or not np.isfinite(numbers).all() or min(numbers) < 0:
            self.senseless.append(f"{keyword.capitalize()} {text}".strip())
            return default
        return vec3(numbers[:3])

    def _number(self, entries: _Entries, keyword: str, default: float) -> float:
        """A number from 0 to 1, d's after its option; the default where there is none."""
        text = entries.values.get(keyword)
        if text is None:
            return default
        numbers = numbers_of(text.removeprefix("-halo"))
        if not numbers or not 0 <= numbers[-1] <= 1:
            self.senseless.append(f"{keyword} {text}".strip())
            return default
        return numbers[-1]

    def _opacity(self, entries: _Entries) -> float:
        """d, or 1 - Tr where there is no d."""
        if "d" in entries.values:
            return self._number(entries, "d", 1.0)
        return 1.0 - self._number(entries, "tr", 0.0)


def _some(names: list[str]) -> str:
    return ", ".join(list(dict.fromkeys(names))[:3])
