"""The grid of jobs that options make: every combination, once each."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from itertools import product
from typing import Any, Literal

from gibench.device import LAYOUTS, SIMT, Layout
from gibench.device.build import preferred_layout
from gibench.errors import BadInput, CannotRun
from gibench.profiles import DeviceProfile
from gibench.techniques.job import AUTO, Job, Shot
from gibench.techniques.registry import PUBLISHED, TUNED, TechniqueSpec, axis_title, declared_axes

VARIANTS = (PUBLISHED, TUNED)

Settings = Mapping[str, Mapping[str, Sequence[Any]]]
"""Values by technique and setting: typed, or text as on the command line; several make an axis."""
WorkgroupSize = int | Literal["auto"]


def grid(
    profiles: Sequence[DeviceProfile],
    specs: Sequence[TechniqueSpec],
    *,
    scenes: Sequence[str] = ("cornell-box",),
    variants: Sequence[str] = (TUNED,),
    layouts: Sequence[str] = (),
    common: Mapping[str, Sequence[Any]] | None = None,
    settings: Settings | None = None,
    receivers: Sequence[int] = (),
    workgroup_sizes: Sequence[WorkgroupSize] = (),
    shot: Shot | None = None,
    seed: int = 0,
) -> list[Job]:
    """Every job asked for, once each, those that share a bake next to each other.

    What is left empty is left to the technique, scene or profile. A setting that a technique does
    not have (``direct`` has no SH order) makes no difference to it, so it is not run twice.

    Args:
        profiles: whose limits bind.
        specs: techniques.
        scenes: built-in names or files.
        variants: ``published``, ``tuned``; a technique without the asked one runs what it has.
        layouts: ``wide``, ``simt``, of ``tuned``; none for what the device prefers.
        common: values by setting, for every technique that has it.
        settings: values by technique and setting.
        receivers: numbers to aim for.
        workgroup_sizes: work-items per group, or ``auto``.
        shot: image, camera, flight and motion.
        seed: of every random choice.

    Raises:
        BadInput: a value is wrong, told before anything long.
        CannotRun: no work-group size asked suits any profile asked.
    """
    check_options(variants, receivers, workgroup_sizes, layouts)
    check_workgroup_sizes(profiles, [size for size in workgroup_sizes if size != AUTO])
    check_settings_names(specs, settings or {})
    found: dict[tuple[Any, ...], Job] = {}
    for scene, count in product(_unique(scenes), _unique(receivers) or (None,)):
        for spec in specs:
            for chosen, (variant, layout), profile in product(
                settings_grid(spec, common or {}, (settings or {}).get(spec.name, {})),
                _shapes(_variants(spec, variants), layouts),
                profiles,
            ):
                for size in _sizes(workgroup_sizes, profile):
                    key = (
                        *(scene, count, spec.name, repr(chosen), variant, layout),
                        *(profile.name, size),
                    )
                    if key not in found:
                        found[key] = Job(
                            technique=spec.name,
                            settings=chosen,
                            variant=variant,
                            scene=scene,
                            profile=profile,
                            workgroup_size=size,
                            receivers=count,
                            seed=seed,
                            shot=shot or Shot(),
                            layout=layout,
                        )
    return list(found.values())


def job_label(job: Job, scene: str) -> str:
    """A short name in words, with the scene's own name."""
    size = "auto" if job.workgroup_size == AUTO else str(job.workgroup_size)
    variant = " ".join(filter(None, (job.variant, job.layout if job.layout == SIMT else None)))
    parts = [job.technique, variant, scene, job.profile.name, f"work-group {size}"]
    for name in declared_axes():
        if (value := getattr(job.settings, name, None)) is not None:
            parts.append(f"{axis_title(name)} {value}")
    return ", ".join(parts)


def with_layouts(jobs: Iterable[Job], cl_device: Any) -> list[Job]:
    """The jobs, those of ``tuned`` with the layout that the device prefers where none is asked."""
    preferred = preferred_layout(cl_device)
    return [
        replace(job, layout=preferred) if job.variant == TUNED and job.layout is None else job
        for job in jobs
    ]


def check_options(
    variants: Sequence[str],
    receivers: Sequence[int],
    workgroup_sizes: Sequence[WorkgroupSize],
    layouts: Sequence[str] = (),
) -> None:
    """Refuse values no technique could take.

    Raises:
        BadInput: naming the option.
    """
    for name, values in (("--receivers", receivers), ("--workgroup-size", workgroup_sizes)):
        for value in values:
            if value != AUTO and value < 1:
                raise BadInput(f"{name} {value} is out of range", mend="give 1 or more")
    for variant in variants:
        if variant not in VARIANTS:
            raise BadInput(
                f"no variant called '{variant}'", mend=f"the variants are {', '.join(VARIANTS)}"
            )
    for layout in layouts:
        if layout not in LAYOUTS:
            raise BadInput(
                f"no layout called '{layout}'", mend=f"the layouts are {', '.join(LAYOUTS)}"
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


def check_settings_names(specs: Sequence[TechniqueSpec], settings: Mapping[str, Any]) -> None:
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


def settings_grid(
    spec: TechniqueSpec, common: Mapping[str, Sequence[Any]], own: Mapping[str, Sequence[Any]]
) -> list[Any]:
    """The settings of ``spec`` for every combination of the values asked for.

    Args:
        spec: the technique.
        common: values by setting; those it does not have are left out.
        own: values by its own setting, which win.

    Raises:
        BadInput: a setting is unknown, mistyped or refused.
    """
    hints = typing.get_type_hints(spec.settings_type)
    known = {item.name for item in fields(spec.settings_type)}
    asked = {name: values for name, values in common.items() if name in known and values}
    axes = []
    for name, values in {**asked, **own}.items():
        if name not in known:
            spec.settings({name: values})  # raises, naming those there are
        option = f"--set {spec.name}.{name}="
        typed = [
            typed_value(hints[name], value, option + value) if isinstance(value, str) else value
            for value in values
        ]
        axes.append([(name, value) for value in _unique(typed)])
    return [spec.settings(dict(chosen)) for chosen in product(*axes)]


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


def _sizes(asked: Sequence[WorkgroupSize], profile: DeviceProfile) -> tuple[WorkgroupSize, ...]:
    sizes = _unique(asked) or (profile.default_workgroup_size,)
    return (*(s for s in sizes if s != AUTO), *(s for s in sizes if s == AUTO))


def _variants(spec: TechniqueSpec, asked: Sequence[str]) -> tuple[str, ...]:
    have = tuple(variant for variant in _unique(asked) if variant in spec.variants)
    return have or spec.variants[:1]


def _shapes(variants: Iterable[str], asked: Sequence[str]) -> list[tuple[str, Layout | None]]:
    """Each variant, ``tuned`` in every layout asked for; a published one is shaped by its paper."""
    layouts = [layout for layout in LAYOUTS if layout in asked]
    return [
        (variant, layout)
        for variant in variants
        for layout in (layouts if variant == TUNED and layouts else (None,))
    ]


def _unique(values: Iterable[Any]) -> tuple[Any, ...]:
    return tuple(dict.fromkeys(values))
