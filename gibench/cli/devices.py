"""``gibench devices``."""

from __future__ import annotations


def devices() -> None:
    """List the OpenCL devices that 'gibench run --device N' can execute on."""
    from rich.markup import escape
    from rich.table import Table

    from gibench.commands.listings import list_devices
    from gibench.report.terminal import console

    table = Table("number", "device", "platform", "driver")
    for name in ("units", "work-group", "local memory", "memory", "floats per vector"):
        table.add_column(name, justify="right")
    for row in list_devices().to_dict("records"):
        table.add_row(
            str(row["number"]),
            escape(row["name"]),
            escape(row["platform"]),
            escape(row["driver"]),
            f"{row['compute_units']}",
            f"{row['max_workgroup_size']:,}",
            f"{row['local_memory_bytes'] / 2**10:,.0f} KiB",
            f"{row['global_memory_bytes'] / 2**30:,.1f} GiB",
            f"{row['vector_width_float']}",
        )
    console().print(table)
