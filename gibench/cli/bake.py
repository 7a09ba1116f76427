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
    scheduler: options.Scheduler = None,
    scheduler_file: options.SchedulerFile = None,
    workers: options.Workers = None,
    seed: options.Seed = 0,
    cache_dir: options.CacheDir = None,
    quiet: options.Quiet = False,
) -> None:
    """Compute ahead what 'gibench run' needs, and keep it in the cache; nothing is timed.

    An interrupted bake goes on where it stopped when it is started again.

    Example:

      gibench bake --scene sponza.obj --sh-order 2 --sh-order 7
    """
    from gibench.commands.bake import bake_ahead
    from gibench.commands.cluster import cluster

    with cluster(scheduler, scheduler_file, workers) as executor:
        for baked in bake_ahead(
            scene=scene,
            technique=technique,
            sh_order=sh_order,
            probes=probes,
            receivers=receivers,
            settings=settings,
            seed=seed,
            cache_dir=cache_dir,
            executor=executor,
        ):
            if not quiet:
                typer.echo(
                    f"{baked.technique} on {baked.scene}: {baked.receivers:,} receivers, "
                    f"{baked.settings}: baked in {baked.seconds:.1f} s"
                )
