"""What is asked of a run, and the grid of configurations it makes."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import product
from typing import Any

from gibench.errors import BadInput, CannotRun
from gibench.profiles import DeviceProfile
from gibench.techniques.registry import PUBLISHED, TUNED, TechniqueSpec

VARIANTS = (PUBLISHED, TUNED)
MAX_SH_ORDER = 7
BY_OPTION = ("sh_order", "probes")
"""Settings that have an option of their own; ``--set`` reaches the others."""


@dataclass(frozen=True)
class Request:
    """The options that make a grid; an empty tuple leaves the choice to the technique or scene.

    Attributes:
        scenes: built-in names or files.
        variants: ``published``, ``tuned``; a technique without the asked one runs what it has.
        settings: further settings by technique and field, as typed by the user.
        auto_workgroup: also run with each pass at its best size, by measurement.
    """

    scenes: tuple[str, ...] = ("cornell-box",)
    variants: tuple[str, ...] = (TUNED,)
    sh_orders: tuple[int, ...] = ()
    probes: tuple[int, ...] = ()
    receivers: tuple[int, ...] = ()
    workgroup_sizes: tuple[int, ...] = ()
    settings: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    auto_workgroup: bool = False


@dataclass(frozen=True)
class Configuration:
    """One point of the grid.

    Attributes:
        number: counted from 1 in the order of the run.
        scene: as the user named it.
        receivers: number to aim for; None leaves it to the scene.
        settings: the technique's settings dataclass.
        auto_workgroup: whether passes take the sizes that measure best.
    """

    number: int
    profile: DeviceProfile
    scene: str
    spec: TechniqueSpec
    variant: str
    settings: Any
    receivers: int | None
    workgroup_size: int
    auto_workgroup: bool = False

    @property
    def sh_order(self) -> int | None:
        """The technique's SH order, None where it has none."""
        return getattr(self.settings, "sh_order", None)

    def label(self, scene: str) -> str:
        """A short name in words, with the scene's own name."""
        parts = [self.spec.name, self.variant, scene, self.profile.name]
        parts.append(
            "work-group auto" if self.auto_workgroup else f"work-group {self.workgroup_size}"
        )
        if self.sh_order is not None:
            parts.append(f"SH order {self.sh_order}")
        return ", ".join(parts)


def grid(
    profiles: Sequence[DeviceProfile], specs: Sequence[TechniqueSpec], request: Request
) -> list[Configuration]:
    """Every configuration asked for, once each, those that share a bake next to each other.

    An option that a technique does not have (``direct`` has no SH order) makes no difference to
    it, so it is not run twice.

    Raises:
        BadInput: an option's value is wrong; raised before any long work.
        CannotRun: no work-group size asked suits any profile asked.
    """
    check_options(request)
    check_workgroup_sizes(profiles, request.workgroup_sizes)
    check_settings_names(specs, request.settings)
    found: dict[tuple[Any, ...], Configuration] = {}
    for scene, receivers in product(_unique(request.scenes), _unique(request.receivers) or (None,)):
        for spec in specs:
            for settings, variant, profile in product(
                settings_grid(spec, request), _variants(spec, request.variants), profiles
            ):
                default = profile.default_workgroup_size
                sizes = [(size, False) for size in _unique(request.workgroup_sizes)]
                if request.auto_workgroup:
                    sizes.append((default, True))
                for size, auto in sizes or [(default, False)]:
                    key = (scene, receivers, spec.name, repr(settings), variant, profile.name, size)
                    if (*key, auto) not in found:
                        found[*key, auto] = Configuration(
                            *(len(found) + 1, profile, scene, spec, variant, settings),
                            *(receivers, size, auto),
                        )
    return list(found.values())


def with_receivers(configuration: Configuration, receivers: int) -> Configuration:
    """The same configuration aiming for another number of receivers."""
    return replace(configuration, receivers=receivers)


def check_options(request: Request) -> None:
    """Refuse values no technique could take.

    Raises:
        BadInput: naming the option.
    """
    for order in request.sh_orders:
        if not 0 <= order <= MAX_SH_ORDER:
            raise BadInput(f"--sh-order {order} is out of range", mend="give 0 to 7")
    for name, values in (
        ("--probes", request.probes),
        ("--receivers", request.receivers),
        ("--workgroup-size", request.workgroup_sizes),
    ):
        for value in values:
            if value < 1:
                raise BadInput(f"{name} {value} is out of range", mend="give 1 or more")
    for variant in request.variants:
        if variant not in VARIANTS:
            raise BadInput(
                f"no variant called '{variant}'", mend=f"the variants are {', '.join(VARIANTS)}"
            )


def check_workgroup_sizes(profiles: Sequence[DeviceProfile], sizes: Sequence[int]) -> None:
    """Refuse work-group sizes none of which suits any profile.

    Raises:
        BadInput: every one is over the largest maximum.
        CannotRun: none is a multiple of a profile's SIMD width within its maximum.
    """
    if not sizes or not profiles:
        return
    largest = max(profiles, key=lambda profile: profile.max_workgroup_size)
    most = largest.max_workgroup_size
    if all(size > most for size in sizes):
        raise BadInput(
            f"--workgroup-size {min(sizes)} is over the {most} of profile {largest.name}",
            mend=f"give at most {most}",
        )
    problems = [p.workgroup_size_problem(size) for p in profiles for size in sizes]
    if all(problems):
        multiples = sorted({p.simd_width for p in profiles})
        raise CannotRun(
            str(problems[0]), mend=f"give a multiple of {' or '.join(map(str, multiples))}"
        )


def check_settings_names(
    specs: Sequence[TechniqueSpec], settings: Mapping[str, Mapping[str, str]]
) -> None:
    """Refuse ``--set`` for a technique that does not run.

    Raises:
        BadInput: naming it.
    """
    names = [spec.name for spec in specs]
    for name in settings:
        if name not in names:
            raise BadInput(
                f"--set {name}.…: technique '{name}' is not part of this run",
                mend=f"it runs {', '.join(names)}",
            )


def settings_grid(spec: TechniqueSpec, request: Request) -> list[Any]:
    """The settings of ``spec`` for every SH order and probe count that it knows.

    Raises:
        BadInput: a setting is unknown, mistyped or refused.
    """
    hints = typing.get_type_hints(spec.settings_type)
    known = {item.name for item in fields(spec.settings_type)}
    typed: dict[str, Any] = {}
    for name, text in request.settings.get(spec.name, {}).items():
        option = f"--set {spec.name}.{name}={text}"
        if name in BY_OPTION:
            raise BadInput(option, mend=f"use --{name.replace('_', '-')} instead")
        if name not in known:
            spec.settings({name: text})  # raises, naming those there are
        typed[name] = typed_value(hints[name], text, option)
    axes = [
        [(name, value) for value in _unique(values)]
        for name, values in zip(BY_OPTION, (request.sh_orders, request.probes), strict=True)
        if name in known and values
    ]
    return [spec.settings({**typed, **dict(chosen)}) for chosen in product(*axes)]


def typed_value(hint: Any, text: str, option: str) -> Any:
    """``text`` as the type ``hint`` of a settings field: bool, int, float, str, None or a choice.

    Raises:
        BadInput: it is none of them.
    """
    choices = typing.get_args(hint) if _is_union(hint) else (hint,)
    if type(None) in choices and text.lower() == "none":
        return None
    for choice in choices:
        if typing.get_origin(choice) is typing.Literal:
            for value in typing.get_args(choice):
                if str(value) == text:
                    return value
        elif choice is bool:
            if text.lower() in _BOOLEANS:
                return _BOOLEANS[text.lower()]
        elif choice is not type(None):
            try:
                return choice(text)
            except (TypeError, ValueError):
                continue
    raise BadInput(f"{option}: '{text}' is not {_in_words(choices)}")


_BOOLEANS = {"true": True, "yes": True, "on": True, "1": True} | {
    "false": False,
    "no": False,
    "off": False,
    "0": False,
}


def _is_union(hint: Any) -> bool:
    return typing.get_origin(hint) in (typing.Union, types.UnionType)


def _in_words(choices: Iterable[Any]) -> str:
    words = {bool: "true or false", int: "a whole number", float: "a number", type(None): "none"}
    parts = []
    for choice in choices:
        if typing.get_origin(choice) is typing.Literal:
            parts.append("one of " + ", ".join(map(str, typing.get_args(choice))))
        else:
            parts.append(words.get(choice, getattr(choice, "__name__", str(choice))))
    return " or ".join(parts)


def _variants(spec: TechniqueSpec, asked: Sequence[str]) -> tuple[str, ...]:
    have = tuple(variant for variant in _unique(asked) if variant in spec.variants)
    return have or spec.variants[:1]


def _unique(values: Iterable[Any]) -> tuple[Any, ...]:
    return tuple(dict.fromkeys(values))
