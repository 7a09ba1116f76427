"""``gibench advise``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from gibench.cli import options
from gibench.errors import BadInput, Interrupted

_ALL: list[str] = []


def advise(
    device_profile: options.Profile = "iphone7",
    budget_ms: Annotated[
        float,
        typer.Option(
            "--budget-ms",
            metavar="MS",
            help="What a frame may take on this machine; 33.3 is 30 frames per second.",
            rich_help_panel=options.GRID,
        ),
    ] = 33.3,
    scene: options.Scene = "cornell-box",
    technique: options.Techniques = _ALL,
    variant: options.Variants = ["tuned"],  # noqa: B006 (typer copies its defaults)
    sh_order: options.ShOrders = None,
    probes: options.Probes = None,
    receivers: options.ReceiverCounts = None,
    settings: options.Set = None,
    light_frame: options.LightFrame = 0,
    target_error: options.TargetError = 0.05,
    reference_paths: options.ReferencePaths = None,
    frames: options.SettleFrames = 256,
    resolution: options.Resolution = "1334x750",
    camera: options.CameraChoice = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Folder for advice.csv, advice.md and the plot; by default "
            "results/advice/<UTC time>-<profile>. Settings that it holds already are not tried "
            "again, whatever the budget.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    seed: options.Seed = 0,
    device: options.DeviceNumber = None,
    cache_dir: options.CacheDir = None,
    quiet: options.Quiet = False,
) -> None:
    """Try techniques and settings on a scene and say which fit a budget, and at what error.

    Tries what every technique declares (SH orders, probes, rays) at all, a half and a quarter of
    the scene's receivers; the options narrow that. Times are of this machine under the profile's
    limits, not of the modelled device.

    Example:

      gibench advise --device-profile iphone7 --budget-ms 33.3 --scene sponza.obj
    """
    from gibench.device.device import select_cl_device
    from gibench.measure.machine.environment import cpu_name
    from gibench.measure.plan.configuration import check_settings_names
    from gibench.measure.runfolder.folder import RunFolder, default_folder
    from gibench.measure.runfolder.record import study_record
    from gibench.measure.session.setup import LoopOptions
    from gibench.report.advice import advice_report, plot_advice, show_advice
    from gibench.report.tables import csv_text
    from gibench.study.advise import RECEIVER_SHARES, advice, check_fit, sweep
    from gibench.study.frozen import FrozenShared
    from gibench.study.quality import COLUMNS, QualityOptions, check_views, compare
    from gibench.study.rows import Rows
    from gibench.study.settle import SettleOptions
    from gibench.techniques.registry import techniques

    if not (math.isfinite(budget_ms) and budget_ms > 0):
        raise BadInput(f"--budget-ms {budget_ms:g} is no time", mend="give more than 0 ms")
    width, height = options.resolution(resolution)
    profile = options.load_profiles([device_profile])[0]
    specs = options.find_techniques(technique or list(techniques()))
    wanted = options.request([scene], variant, sh_order, probes, receivers, None, settings)
    check_settings_names(specs, wanted.settings)
    cl_device = select_cl_device(device)
    shared = FrozenShared(options.cache_folder(cache_dir), seed, light_frame=light_frame)
    own = shared.scene(scene).receivers
    configurations = sweep(
        profile,
        specs,
        scene,
        shared.scene(scene),
        wanted.variants,
        wanted.receivers or tuple(max(1, round(own * share)) for share in RECEIVER_SHARES),
        {"sh_order": wanted.sh_orders, "probes": wanted.probes},
        wanted.settings,
    )
    how = QualityOptions(
        LoopOptions(width=width, height=height, camera=camera, seed=seed),
        SettleOptions(frames),
        target_error=target_error,
        reference_paths=reference_paths,
        flip=False,  # none of its tables shows it
    )
    check_views(configurations, how, shared)
    path = out or Path("results", "advice", default_folder([profile.name]).name)
    # The budget is no part of it: what is there is judged by another one without measuring again.
    asked = options.recorded(locals(), "light_frame", "target_error", "reference_paths")
    asked["command"] = "advise"
    folder = RunFolder.create(path, asked)
    folder.write_record(study_record(asked, cl_device))
    kept = Rows.at(folder.path / "settings.csv", ("number",), COLUMNS)
    outcome = compare(
        configurations,
        how,
        shared,
        cl_device,
        keep=lambda number, rows: kept.add([{"number": number, **row} for row in rows]),
        done={c.number for c in configurations if kept.done({"number": c.number})},
    )
    rows = kept.table().fillna({"reason": ""}).drop(columns="number")
    if rows.empty:
        raise Interrupted("interrupted before anything was measured")
    table = advice(rows, budget_ms)
    warnings = shared.scene(scene).warnings
    folder.write_text("advice.csv", csv_text(table))
    folder.write_text(
        "advice.md", advice_report(table, profile.name, budget_ms, cpu_name(), warnings)
    )
    if (table["status"] == "ok").any():
        plot_advice(folder.path / "pareto", table, budget_ms, cpu_name())
    if not quiet:
        show_advice(table, profile.name, budget_ms, cpu_name())
        typer.echo(f"see {folder.path}")
    if outcome.interrupted:
        raise Interrupted(
            f"interrupted; {len(table)} of {len(configurations)} settings were tried, see "
            f"{folder.path}; the same command with --out {folder.path} goes on from there"
        )
    check_fit(table, budget_ms)
