"""Materials of OBJ files (Wavefront, MTL format; Pr, Pm, Ke, norm: Exocortex's PBR extension).

Kd is the albedo, times map_Kd; Ke is emitted radiance, times map_Ke; d (or 1 - Tr) is opacity.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gibench.arrays import Vec3
from gibench.errors import BadInput
from gibench.scene.files import find_near, read_bytes
from gibench.scene.model import BLACK, Material, Texture
from gibench.scene.readers.content import Array, Maps, counted, vec3
from gibench.scene.readers.float_images import UnreadableImage
from gibench.scene.readers.text import argument, read_text, statements, without_comment
from gibench.scene.readers.textures import (
    bumps_from_bytes,
    normals_from_bytes,
    opacity_from_bytes,
    radiance_from_bytes,
    texture_from_bytes,
)

# Kd of a face without a material, or of a material that names none. The MTL specification gives
# no default; 0.8 is Material's own.
DEFAULT_COLOR: Vec3 = Material("default").base_color
WHITE: Vec3 = (1.0, 1.0, 1.0)

# Options of texture maps and how many arguments each takes at most (MTL specification); -o, -s and
# -t take one to three numbers.
_MAP_OPTIONS = {
    "-blendu": 1, "-blendv": 1, "-boost": 1, "-bm": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1,
    "-mm": 2, "-o": 3, "-s": 3, "-t": 3, "-texres": 1, "-type": 1,
}  # fmt: skip
# Options that change nothing here: of filtering, of images' resolution, of colour correction.
_HARMLESS = ("-blendu", "-blendv", "-boost", "-cc", "-texres", "-type", "-imfchan")

_NORMAL_MAPS = ("norm", "map_bump", "bump")
NORMAL_MAP = "normal map"
"""The keyword that coordinates of normal maps are asked for by, whichever statement named one."""

Decoder = Callable[[str, bytes], Texture]
Transform = tuple[tuple[float, float], tuple[float, float]]
"""Scale and offset of texture coordinates: u' = u * scale + offset."""


@dataclass(frozen=True)
class MapStatement:
    """A ``map_`` statement.

    Attributes:
        file: the name as written, without quotes.
        transform: of its texture coordinates.
        ignored: options that would change the picture and are not used.
        strength: of a bump map (-bm).
    """

    file: str
    transform: Transform = ((1.0, 1.0), (0.0, 0.0))
    ignored: tuple[str, ...] = ()
    strength: float = 1.0


@dataclass
class _Entries:
    """The statements of one material: argument by lower case keyword, and its file's folder."""

    folder: Path
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
        self.missing: list[str] = []
        self.options: list[str] = []
        self.senseless: list[str] = []

    def read_statement(self, text: str) -> None:
        """All libraries that one ``mtllib`` names."""
        files, unknown = _library_files(self.folder, text)
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
                entries = _Entries(file.parent)
                self.found[" ".join(argument(statement).split())] = entries
            elif entries is not None:
                entries.values[keyword] = argument(statement)

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
        if self.missing:
            self.warnings.append(
                f"{counted(len(set(self.missing)), 'texture')} missing or unreadable "
                f"({_some(self.missing)}): plain colours used"
            )
        if self.options:
            self.warnings.append(f"options of texture maps not used: {_some(self.options)}")
        if self.senseless:
            self.warnings.append(
                f"{counted(len(self.senseless), 'statement')} of materials not understood "
                f"({_some(self.senseless)}): defaults used"
            )

    def _material(self, name: str, number: int, entries: _Entries) -> tuple[Material, Maps]:
        texture, emission_map, opacity_map = -1, None, None
        image = self._image(entries, number, "map_kd")
        if image is not None:
            texture = self._texture(*image)
        glow = self._image(entries, number, "map_ke")
        if glow is not None:
            emission_map = self._decoded(*glow, radiance_from_bytes)
        cut_out = self._image(entries, number, "map_d")
        if cut_out is not None:
            opacity_map = self._decoded(*cut_out, opacity_from_bytes)
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
        bumps = self._normal_map(entries, number)
        material = Material(
            name=name or "default",
            base_color=vec3(np.clip(color, 0.0, 1.0)),
            emission=emission,
            texture=texture,
            emission_map="" if emission_map is None else emission_map.name,
            alpha_mode="mask" if cut_out else "blend" if opacity < 1 else "opaque",
            opacity=opacity,
            opacity_map="" if opacity_map is None else opacity_map.name,
            roughness=self._number(entries, "pr", 1.0),
            metalness=self._number(entries, "pm", 0.0),
            roughness_map=self._name(entries, "map_pr", "map_pm"),
            normal_map=self._name(entries, *_NORMAL_MAPS),
        )
        return material, Maps(emission=emission_map, opacity=opacity_map, normal=bumps)

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
        file = find_near((entries.folder, self.folder), statement.file)
        if file is None:
            self.missing.append(statement.file)
            return None
        if statement.transform != MapStatement("").transform:
            self.transforms[number, keyword] = statement.transform
        self.options += statement.ignored
        return statement.file, file

    def _texture(self, name: str, file: Path) -> int:
        if file not in self.textures:
            texture = self._decoded(name, file, texture_from_bytes)
            if texture is None:
                return -1
            self.textures[file] = texture
        return list(self.textures).index(file)

    def _decoded(self, name: str, file: Path, decode: Decoder) -> Texture | None:
        try:
            return decode(name, read_bytes(file))
        except (UnreadableImage, BadInput):
            self.missing.append(name)
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
        numbers = _numbers(text)
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
        numbers = _numbers(text.removeprefix("-halo"))
        if not numbers or not 0 <= numbers[-1] <= 1:
            self.senseless.append(f"{keyword} {text}".strip())
            return default
        return numbers[-1]

    def _opacity(self, entries: _Entries) -> float:
        """d, or 1 - Tr where there is no d."""
        if "d" in entries.values:
            return self._number(entries, "d", 1.0)
        return 1.0 - self._number(entries, "tr", 0.0)


def map_statement(text: str) -> MapStatement:
    """A ``map_`` statement's file, which may hold blanks, and its options."""
    rest = without_comment(text)
    scale, offset, strength = [1.0, 1.0], [0.0, 0.0], 1.0
    ignored = []
    while (option := rest.partition(" ")[0].lower()) in _MAP_OPTIONS:
        rest = rest.partition(" ")[2].strip()
        given: list[str] = []
        for i in range(_MAP_OPTIONS[option]):
            word, _, after = rest.partition(" ")
            if (i > 0 or option in ("-o", "-s", "-t", "-mm")) and not _numbers(word):
                break
            given.append(word)
            rest = after.strip()
        if option in ("-s", "-o"):
            for i, number in enumerate(_numbers(" ".join(given))[:2]):
                (scale if option == "-s" else offset)[i] = number
        elif option == "-bm":
            strength = next(iter(_numbers(" ".join(given))), 1.0)
        elif option not in _HARMLESS and not (option == "-clamp" and given == ["off"]):
            ignored.append(f"{option} {' '.join(given)}")
    transform = ((scale[0], scale[1]), (offset[0], offset[1]))
    if not np.isfinite(transform).all():
        transform = MapStatement("").transform
    strength = strength if np.isfinite(strength) else 1.0
    return MapStatement(rest.strip().strip('"'), transform, tuple(ignored), strength)


def _numbers(text: str) -> list[float]:
    """The numbers that ``text`` is made of; none where a word is no number, but for a comment."""
    try:
        return [float(word) for word in without_comment(text).split()]
    except ValueError:
        return []


def _some(names: list[str]) -> str:
    return ", ".join(list(dict.fromkeys(names))[:3])


def _library_files(folder: Path, text: str) -> tuple[list[Path], list[str]]:
    """The files that ``mtllib`` names, and the names of those that are missing.

    Names are separated by blanks and may hold them: the longest that is a file is taken.
    """
    short = without_comment(text)
    for whole in (text, short):
        if file := find_near((folder,), whole.strip('"')):
            return [file], []
    words = re.findall(r'"[^"]*"|\S+', short)
    files, unknown = [], []
    while words:
        for count in range(len(words), 0, -1):
            name = " ".join(words[:count]).strip('"')
            if file := find_near((folder,), name):
                files.append(file)
                break
        else:
            count = 1
            unknown.append(words[0].strip('"'))
        words = words[count:]
    return (files, unknown) if files else ([], [short or text])
