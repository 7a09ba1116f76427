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

    from gibench.commands.listings import list_profiles
    from gibench.report.terminal import console

    table = Table("name", "device")
    for name in ("work-group", "SIMD", "local memory", "memory budget", "largest buffer"):
        table.add_column(name, justify="right")
    for row in list_profiles().to_dict("records"):
        table.add_row(
            row["name"],
            escape(row["device"]),
            f"{row['max_workgroup_size']:,}",
            f"{row['simd_width']}",
            f"{row['local_memory_bytes'] / 2**10:,.0f} KiB",
            f"{row['memory_budget_bytes'] / 2**20:,.0f} MiB",
            f"{row['max_buffer_bytes'] / 2**20:,.0f} MiB",
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

    from gibench.commands.listings import show_profile
    from gibench.report.terminal import console

    shown = show_profile(name)
    if toml:
        typer.echo(shown.text, nl=False)
        return
    title = escape(f"{shown.profile.name}: {shown.profile.title}")
    table = Table("figure", title=title, title_justify="left")
    table.add_column("value", justify="right", no_wrap=True)
    table.add_column("source", overflow="fold")
    for row in shown.figures.to_dict("records"):
        table.add_row(row["figure"], f"{row['value']:,.10g}", escape(row["source"]))
    out = console()
    out.print(table)
    if shown.machine is not None:
        machine = Table("machine", title="What times are projected from", title_justify="left")
        for heading in ("low", "nominal", "high"):
            machine.add_column(heading, justify="right", no_wrap=True)
        machine.add_column("source", overflow="fold")
        for row in shown.machine.to_dict("records"):
            numbers = (f"{row[key]:,.10g}" for key in ("low", "nominal", "high"))
            machine.add_row(row["figure"], *numbers, escape(row["source"]))
        out.print(machine)
    out.print(f"SHA-256 {shown.profile.content_hash}", soft_wrap=True)


@app.command()
def check(
    name: Annotated[str, typer.Argument(metavar="NAME|FILE", help="Profile to check.")],
) -> None:
    """Check a profile: a line for every fault, and what its machine part says."""
    from gibench.commands.listings import check_profile

    checked = check_profile(name)
    for fault in checked.faults[:-1]:
        typer.echo(f"gibench: {fault}", err=True)
    if checked.faults or checked.profile is None:
        raise checked.faults[-1]
    spread = checked.spread
    widest = max(spread, key=lambda figure: spread[figure])
    typer.echo(
        f"{checked.profile.name}: sound; {len(spread)} figures of the machine, "
        f"{len(checked.estimated)} of them estimates; the least known is {widest} "
        f"({spread[widest]:.3g} times from low to high)"
    )
