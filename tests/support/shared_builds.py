"""One OpenCL context a device and one build a program, for all tests of a process.

Tests open hundreds of devices (:class:`gibench.device.Device`), each with a context of its own, in
which every program would be built and every kernel loaded anew. What is built depends on nothing
but source and options, so that tests lose nothing by sharing it. Queues, buffers, kernels with
their arguments, and what a device counts of its memory stay each device's own.
"""

from __future__ import annotations

import re
from functools import wraps
from typing import Any

import pyopencl as cl

from gibench.device.build import WITHOUT_HEADER

ALLOWED = "// calls what is not declared"
"""In the source of a test that builds such a program on purpose."""


def share_builds() -> None:
    """From now on ``cl.Context([device])`` and ``cl.Program(...).build()`` return what there is.

    Builds that fail are not kept, and one for want of a builtin that common/declared.cl could
    declare fails the test: it would be built once more, slowly. Contexts of several devices or with
    properties, and builds for chosen devices, are made as ever.
    """
    contexts: dict[tuple[Any, ...], Any] = {}
    programs: dict[tuple[Any, ...], Any] = {}
    new_context, build = cl.Context, cl.Program.build

    @wraps(new_context, updated=())
    def context(*args: Any, **kwargs: Any) -> Any:
        if len(args) != 1 or kwargs or len(args[0]) != 1:
            return new_context(*args, **kwargs)
        key = (args[0][0].int_ptr,)
        if key not in contexts:
            contexts[key] = new_context(*args)
        return contexts[key]

    @wraps(build)
    def build_once(self: Any, options: Any = (), *args: Any, **kwargs: Any) -> Any:
        source = getattr(self, "_source", None)
        if args or kwargs or source is None or isinstance(options, str):
            return build(self, options, *args, **kwargs)
        key = (self._context.int_ptr, source, tuple(options))
        if key not in programs:
            try:
                programs[key] = build(self, options)
            except cl.RuntimeError as error:
                undeclared = re.search("implicit declaration of function '(.*)'", str(error))
                if undeclared and not {*WITHOUT_HEADER}.isdisjoint(options):
                    assert ALLOWED in source, f"common/declared.cl has no {undeclared[1]}"
                raise
        return programs[key]

    cl.Context, cl.Program.build = context, build_once
