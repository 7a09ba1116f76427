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

    from gibench.profiles import load_profile, profile_text
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
    out.print(f"SHA-256 {profile.content_hash}", soft_wrap=True)
