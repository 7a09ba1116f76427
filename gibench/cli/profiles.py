"""``gibench profiles`` and ``gibench profiles show NAME``."""

from __future__ import annotations

from typing import Annotated

import typer

from gibench.cli.options import paragraphs

SUMMARY = "List the device profiles, or show one with the source of each figure."
_HELP = f"""
{SUMMARY}

A profile is a TOML file; your own is given by its path wherever a name is asked for.

Examples:

gibench profiles

gibench profiles show iphone7

gibench profiles show iphone7 --toml > mine.toml

gibench profiles check mine.toml
"""

app = typer.Typer(rich_markup_mode=None)


@app.callback(invoke_without_command=True, help=paragraphs(_HELP))
def profiles(context: typer.Context) -> None:
    """List the device profiles."""
    if context.invoked_subcommand is not None:
        return
    from rich.markup import escape
    from rich.table import Table

    from gibench.profiles import built_in_profiles, load_profile
    from gibench.report.terminal import console

    table = Table("name", "device")
    for name in ("work-group", "SIMD", "local memory", "memory budget", "largest buffer"):
        table.add_column(name, justify="right")
    for name in built_in_profiles():
        profile = load_profile(name)
        table.add_row(
            name,
            escape(profile.title),
            f"{profile.max_workgroup_size:,}",
            f"{profile.simd_width}",
            f"{profile.local_memory_bytes / 2**10:,.0f} KiB",
            f"{profile.memory_budget_bytes / 2**20:,.0f} MiB",
            f"{profile.max_buffer_bytes / 2**20:,.0f} MiB",
        )
    console().print(table)


@app.command()
def show(
    name: Annotated[str, typer.Argument(metavar="NAME|FILE", help="Profile to show.")],
    toml: Annotated[
        bool, typer.Option("--toml", help="Print the TOML file as it is, to copy and change.")
    ] = False,
) -> None:
    """Show a profile: every figure with its source."""
    from rich.markup import escape
    from rich.table import Table

    from gibench.profiles import MACHINE_FIGURES, load_profile, profile_text
    from gibench.report.terminal import console

    profile = load_profile(name)
    if toml:
        typer.echo(profile_text(name), nl=False)
        return
    table = Table("figure", title=escape(f"{profile.name}: {profile.title}"), title_justify="left")
    table.add_column("value", justify="right", no_wrap=True)
    table.add_column("source", overflow="fold")
    for key, figure in profile.figures.items():
        table.add_row(key, f"{figure.value:,.10g}", escape(figure.source))
    out = console()
    out.print(table)
    if profile.machine is not None:
        shown = Table("machine", title="What times are projected from", title_justify="left")
        for heading in ("low", "nominal", "high"):
            shown.add_column(heading, justify="right", no_wrap=True)
        shown.add_column("source", overflow="fold")
        for key in MACHINE_FIGURES:
            each = getattr(profile.machine, key)
            numbers = (f"{number:,.10g}" for number in (each.low, each.nominal, each.high))
            shown.add_row(key, *numbers, escape(each.source))
        out.print(shown)
    out.print(f"SHA-256 {profile.content_hash}", soft_wrap=True)


@app.command()
def check(
    name: Annotated[str, typer.Argument(metavar="NAME|FILE", help="Profile to check.")],
) -> None:
    """Check a profile: a line for every fault, and what its machine part says."""
    from gibench.errors import BadInput
    from gibench.profiles import MACHINE_FIGURES, profile_text, read_profile

    profile, faults = read_profile(profile_text(name), where=name)
    if profile is None:
        for fault in faults[:-1]:
            typer.echo(f"gibench: {fault}", err=True)
        raise faults[-1]
    if profile.machine is None:
        raise BadInput(
            "has no machine part: limits hold, nothing can be projected",
            where=name,
            mend=f"add [machine] with {', '.join(MACHINE_FIGURES)}",
        )
    intervals = {key: getattr(profile.machine, key) for key in MACHINE_FIGURES}
    estimated = [key for key, each in intervals.items() if each.estimated]
    widest = max(intervals, key=lambda key: intervals[key].spread)
    typer.echo(
        f"{profile.name}: sound; {len(intervals)} figures of the machine, {len(estimated)} of them "
        f"estimates; the least known is {widest} ({intervals[widest].spread:.3g} times from low to "
        "high)"
    )
