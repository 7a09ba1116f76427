"""Streams of launches, kept on disk by a hash of what was traced: a launch is traced once, whatever
it is projected on.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Sequence
from dataclasses import fields
from functools import cache as once
from pathlib import Path
from typing import Any

import numpy as np

from gibench.files import write_whole
from gibench.trace.request import Sampling, TraceRequest
from gibench.trace.streams import WaveStreams, thinned

VERSION = 3
"""Of what is kept: another one makes traces anew."""
SAMPLING = Sampling(runs=3, length=24, words=16 << 20, seconds=5.0, unroll=True)
"""Runs long enough that groups which share a unit and its caches are in them."""


def streams_of(
    request: TraceRequest,
    widths: Sequence[int],
    cache: Path | None = None,
    sampling: Sampling = SAMPLING,
) -> dict[int, WaveStreams]:
    """The streams of a launch at several widths, traced where they are not in the cache.

    Args:
        request: what is launched.
        widths: lanes of a wave, at most 64 each.
        cache: where traces are kept; None keeps none.
        sampling: how much is traced.

    Raises:
        GibenchError: it cannot be traced, or faults.
    """
    key = request_key(request, sampling) if cache is not None else ""
    found: dict[int, WaveStreams] = {}
    missing = []
    for width in dict.fromkeys(widths):
        kept = None if cache is None else _kept(cache / f"trace-{key}-{width}.npz")
        if kept is None:
            missing.append(width)
        else:
            found[width] = kept
    if missing:
        from gibench.trace.analysis import wave_streams
        from gibench.trace.trace import trace_launch

        trace = trace_launch(request, sampling)
        for width in missing:
            found[width] = thinned(wave_streams(trace, width))
            if cache is not None:
                _keep(cache / f"trace-{key}-{width}.npz", found[width])
    return found


def request_key(request: TraceRequest, sampling: Sampling) -> str:
    """A hash of everything that a trace depends on, the compilers and the processor among them."""
    digest = hashlib.sha256(
        repr(
            (
                *(VERSION, compilers(), sampling, request.source, sorted(request.defines.items())),
                *(request.kernel, request.items, request.groups, *request.sides),
            )
        ).encode()
    )
    for each in request.args:
        digest.update(repr((each.name, each.nbytes, each.written)).encode())
        if each.data is not None:
            data = np.ascontiguousarray(each.data)
            digest.update(repr((data.dtype.str, data.shape)).encode())
            digest.update(data.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()[:32]


@once
def compilers() -> tuple[str, ...]:
    """What makes bitcode of a source and runs it: PoCL, llvmlite and its LLVM, the processor.

    Raises:
        CannotRun: there is no OpenCL device.
    """
    import llvmlite
    import llvmlite.binding as llvm

    from gibench.device import list_devices

    device = list_devices()[0]
    return (
        *(device.platform.version, device.version, device.driver_version),
        *(llvmlite.__version__, str(llvm.llvm_version_info)),
        *(llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()),
    )


def _kept(path: Path) -> WaveStreams | None:
    if not path.is_file():
        return None
    try:
        with np.load(path) as stored:
            values: dict[str, Any] = {}
            for each in fields(WaveStreams):
                value = stored[each.name]
                values[each.name] = value.item() if value.ndim == 0 else value
    except (OSError, ValueError, KeyError):
        return None  # cut short by a crash: traced anew
    return WaveStreams(**values)


def _keep(path: Path, streams: WaveStreams) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    content = io.BytesIO()
    np.savez_compressed(
        content, **{each.name: getattr(streams, each.name) for each in fields(streams)}
    )
    write_whole(path, content.getvalue())
