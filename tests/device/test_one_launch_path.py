"""Every kernel leaves through the device: nothing else builds, makes or enqueues one."""

from __future__ import annotations

import ast
from pathlib import Path

import gibench

ROOT = Path(gibench.__file__).parent
ONLY_IN = "device"
# Of pyopencl, what would be a second way to a kernel or a buffer.
DOORS = {"Kernel", "Program", "enqueue_nd_range_kernel", "Buffer", "enqueue_copy"}


def doors(path: Path) -> list[str]:
    """Where a file uses one of DOORS of pyopencl."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
        if alias.name == "pyopencl"
    }
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno} {node.attr}"
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and node.attr in DOORS
        and isinstance(node.value, ast.Name)
        and node.value.id in names
    ]
    imported = [
        f"{path.relative_to(ROOT)}:{node.lineno} {alias.name}"
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("pyopencl")
        for alias in node.names
        if alias.name in DOORS
    ]
    return found + imported


def test_kernels_and_buffers_leave_through_the_device_alone() -> None:
    files = {path: doors(path) for path in ROOT.rglob("*.py")}
    assert any(files[path] for path in (ROOT / ONLY_IN).rglob("*.py"))
    elsewhere = [
        door
        for path, found in files.items()
        if path.relative_to(ROOT).parts[0] != ONLY_IN
        for door in found
    ]
    assert elsewhere == []


def test_no_kernel_is_edited_to_count_rays() -> None:
    kernels = ROOT.parent / "kernels_cl"
    users = {
        path.relative_to(kernels).as_posix()
        for path in kernels.rglob("*.cl")
        if "RAY_COUNTS" in path.read_text(encoding="utf-8")
    }
    assert users == {"common/bvh.cl"}
