"""``gibench bake``."""

from __future__ import annotations

import typer

from gibench.cli import options


def bake(
    scene: options.Scenes = ["cornell-box"],  # noqa: B006 (typer copies its defaults)
    technique: options.Techniques = ["srp"],  # noqa: B006
    sh_order: options.ShOrders = None,
    probes: options.Probes = None,
    receivers: options.ReceiverCounts = None,
    settings: options.Set = None,
    seed: options.Seed = 0,
    cache_dir: options.CacheDir = None,
    quiet: options.Quiet = False,
) -> None:
    """Compute ahead what 'gibench run' needs, and keep it in the cache; nothing is timed.

    An interrupted bake goes on where it stopped when it is started again.

    Example:

      gibench bake --scene sponza.obj --sh-order 2 --sh-order 7
    """
    import time

    from gibench.commands import asked
    from gibench.measure.plan.grid import check_options, check_settings_names, settings_grid
    from gibench.measure.session.shared import Shared

    specs = asked.find_techniques(technique)
    chosen_settings = asked.read_settings(settings)
    common = asked.by_option(sh_order, probes)
    check_options((), asked.several(receivers), ())
    check_settings_names(specs, chosen_settings)
    work = [
        (spec, chosen)
        for spec in specs
        for chosen in settings_grid(spec, common, chosen_settings.get(spec.name, {}))
    ]
    shared = Shared(asked.cache_folder(cache_dir), seed)
    names = asked.several(scene)
    for name in names:
        shared.scene(name)
    for name in names:
        for count in asked.several(receivers) or (shared.scene(name).receivers,):
            for spec, chosen in work:
                begin = time.perf_counter()
                lightmap, _ = shared.baked(spec, chosen, name, count)
                if not quiet:
                    typer.echo(
                        f"{spec.name} on {shared.scene(name).name}: {len(lightmap.receivers):,} "
                        f"receivers, {chosen}: baked in {time.perf_counter() - begin:.1f} s"
                    )
