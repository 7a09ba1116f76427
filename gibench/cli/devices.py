"""``gibench devices``."""

from __future__ import annotations


def devices() -> None:
    """List the OpenCL devices that 'gibench run --device N' can execute on."""
    from rich.markup import escape
    from rich.table import Table

    from gibench.device import list_devices
    from gibench.measure.machine.environment import device_record
    from gibench.report.terminal import console

    table = Table("number", "device", "platform", "driver")
    for name in ("units", "work-group", "local memory", "memory", "floats per vector"):
        table.add_column(name, justify="right")
    for number, device in enumerate(list_devices()):
        record = device_record(device)
        table.add_row(
            str(number),
            escape(record["name"]),
            escape(record["platform"]),
            escape(record["driver"]),
            f"{record['compute_units']}",
            f"{record['max_workgroup_size']:,}",
            f"{record['local_memory_bytes'] / 2**10:,.0f} KiB",
            f"{record['global_memory_bytes'] / 2**30:,.1f} GiB",
            f"{record['vector_width_float']}",
        )
    console().print(table)
