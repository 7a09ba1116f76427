"""Running an instrumented kernel, group by group, on this processor."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Longs
from gibench.trace.instrument import WORDS_SPARE, WORK_DIM, Instrumented
from gibench.trace.lower import machine
from gibench.trace.memory import Arena
from gibench.trace.request import Sampling, TraceRequest


@dataclass(frozen=True)
class Record:
    """What the sampled groups did.

    Attributes:
        words: of all groups one behind another: ``-1 - block``, then the block's addresses.
        ends: where every work-item's words end (groups * items,), they begin where the last one's
            ended.
        groups: the number of every traced group (n,), ascending.
        run: which run of adjacent groups each belongs to (n,).
        range_start: addresses of buffers and local memory (r,).
        range_end: behind them (r,).
        too_large: whether a single group had more to tell than there was room for.
    """

    words: Longs
    ends: Longs
    groups: Longs
    run: Longs
    range_start: Longs
    range_end: Longs
    too_large: bool


class Machine:
    """A compiled kernel with its arguments.

    Args:
        instrumented: the kernel.
        request: what is launched.
        capacity: words of the record.

    Attributes:
        arena: of buffers and local memory given as arguments, in the arguments' order.
        names: of the ranges: arguments, then the kernel's own local arrays and the program's
            constant ones.
        constants: names of those that lie in constant memory.
    """

    def __init__(self, instrumented: Instrumented, request: TraceRequest, capacity: int) -> None:
        import llvmlite.binding as llvm

        self._request, self._barriers = request, instrumented.has_barriers
        placed = [a for a in request.args if a.is_buffer or a.data is None]
        sizes = [a.nbytes if a.data is None else int(a.data.nbytes) for a in placed]
        self.arena = Arena(sizes)
        if self._barriers:
            self._barrier = ctypes.CFUNCTYPE(None)(_wait)
            llvm.add_symbol("pocl.barrier", ctypes.cast(self._barrier, ctypes.c_void_p).value)
        module = llvm.parse_assembly(instrumented.text)
        module.verify()
        self._engine = llvm.create_mcjit_compiler(module, machine(llvm))
        self._engine.finalize_object()
        self.words = np.empty(WORDS_SPARE + capacity, np.int64)
        self._count = self._variable("__trace_count")
        self._variable("__trace_capacity").value = len(self.words)
        self._variable("__trace_words").value = self.words.ctypes.data
        self._item: Callable[[int], None] = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(
            self._engine.get_function_address("__trace_item")
        )
        self._group: Callable[[int, int, int], None] = ctypes.CFUNCTYPE(
            None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p
        )(self._engine.get_function_address("__trace_group"))
        self._fill(placed)
        arrays = (*instrumented.locals, *instrumented.constants)
        own = [(self._address(name), nbytes) for name, nbytes in arrays]
        self.names = [a.name for a in placed] + [name for name, _ in arrays]
        self.constants = [request.args[number].name for number in instrumented.constant_args]
        self.constants += [name for name, _ in instrumented.constants]
        self.range_start = np.array([*self.arena.starts, *(a for a, _ in own)], np.int64)
        self.range_end = np.array([*self.arena.ends, *(a + n for a, n in own)], np.int64)

    def run(self, groups: Sequence[int]) -> tuple[Longs, Longs] | None:
        """Run groups and return each item's words, one behind another, and where they end; None
        where they are too many.
        """
        items = self._request.items
        parts, ends, total = [], [], 0
        for group in groups:
            found = self._one(group)
            if found is None:
                return None
            words, own = found
            parts.append(words)
            ends.append(own + total)
            total += len(words)
        assert all(len(own) == items for own in ends)
        return np.concatenate(parts), np.concatenate(ends)

    def _one(self, group: int) -> tuple[Longs, Longs] | None:
        request = self._request
        for name, values in (
            ("local_size", request.group_size),
            ("num_groups", request.group_count),
            ("group_id", _place(group, request.group_count)),
        ):
            for axis, value in zip("xyz", values, strict=True):
                self._variable(f"_{name}_{axis}").value = value
        ctypes.c_int32.from_address(self._address(WORK_DIM)).value = len(request.groups)
        self._count.value = WORDS_SPARE
        spans = self._waiting() if self._barriers else self._straight()
        if self._count.value > len(self.words):
            return None
        item, first, last = spans.T
        order = np.argsort(item, kind="stable")
        lengths = (last - first)[order]
        words = (
            np.concatenate([self.words[a:b] for a, b in spans[order, 1:]])
            if self._barriers
            else self.words[WORDS_SPARE : self._count.value].copy()
        )
        ends = np.cumsum(np.bincount(item[order], lengths, request.items)).astype(np.int64)
        return words, ends

    def _straight(self) -> Longs:
        """Items that never wait, one after another: rows of item, first and last word."""
        items = self._request.items
        starts = np.empty(items + 1, np.int64)
        self._group(ctypes.addressof(self._pointers), items, starts.ctypes.data)
        starts[items] = self._count.value
        return np.stack([np.arange(items), starts[:-1], starts[1:]], axis=1)

    def _waiting(self) -> Longs:
        """Items that wait for each other, each on a stack of its own."""
        from greenlet import greenlet

        own = [self._variable(f"_local_id_{axis}") for axis in "xyz"]
        size, args = self._request.group_size, ctypes.addressof(self._pointers)

        def body() -> bool:
            self._item(args)
            return False

        fibres = [greenlet(body) for _ in range(self._request.items)]
        alive, spans = list(range(len(fibres))), []
        while alive:
            waiting = []
            for item in alive:
                for variable, value in zip(own, _place(item, size), strict=True):
                    variable.value = value
                first = self._count.value
                if fibres[item].switch():
                    waiting.append(item)
                spans.append((item, first, self._count.value))
            alive = waiting
        return np.array(spans, np.int64)

    def _fill(self, placed: Sequence[Any]) -> None:
        self._values: list[npt.NDArray[np.uint8]] = []
        place = 0
        for argument in self._request.args:
            if argument.is_buffer or argument.data is None:
                if argument.data is not None:
                    data = np.ascontiguousarray(argument.data).reshape(-1).view(np.uint8)
                    self.arena.view(place)[:] = data
                value = np.array([self.arena.starts[place]], np.int64).view(np.uint8)
                place += 1
            else:
                value = np.frombuffer(np.asarray(argument.data).tobytes(), np.uint8).copy()
            self._values.append(value)
        addresses = [value.ctypes.data for value in self._values]
        self._pointers = (ctypes.c_void_p * max(1, len(addresses)))(*addresses)

    def _address(self, name: str) -> int:
        return int(self._engine.get_global_value_address(name))

    def _variable(self, name: str) -> ctypes.c_int64:
        return ctypes.c_int64.from_address(self._address(name))


def _place(number: int, sizes: tuple[int, int, int]) -> tuple[int, int, int]:
    """Where the ``number``-th lies along three dimensions, the first running fastest."""
    across, down, _ = sizes
    return number % across, number // across % down, number // (across * down)


def _wait() -> None:
    """A barrier: the group goes on with its other items."""
    from greenlet import getcurrent

    getcurrent().parent.switch(True)


def plan_groups(total: int, runs: int, length: int) -> list[list[int]]:
    """Runs of adjacent groups, spread evenly: of ``total`` all where that is no more.

    >>> plan_groups(100, 3, 2)
    [[0, 1], [49, 50], [98, 99]]
    """
    if total <= runs * length:
        return [list(range(at, min(at + length, total))) for at in range(0, total, length)]
    last = total - length
    starts = [round(last * run / max(1, runs - 1)) for run in range(runs)]
    return [list(range(start, start + length)) for start in starts]


def record(
    machine: Machine, request: TraceRequest, sampling: Sampling, tell: Callable[[int], None]
) -> Record:
    """Run the groups that ``sampling`` asks for, as far as room and time go, first the first of
    every run.

    Args:
        machine: the kernel.
        request: what is launched.
        sampling: how much of it.
        tell: is told every group before it runs.
    """
    total = int(np.prod(request.groups))
    runs = plan_groups(total, sampling.runs, sampling.length)
    turns = [
        (run, each[n])
        for n in range(max(map(len, runs)))
        for run, each in enumerate(runs)
        if n < len(each)
    ]
    done: dict[int, tuple[int, tuple[Longs, Longs]]] = {}
    used = largest = 0
    begin = time.process_time()
    for run, group in turns:
        late = time.process_time() - begin > sampling.seconds
        if done and not sampling.whole and (late or used + largest > sampling.words):
            break
        tell(group)
        found = machine.run([group])
        if found is None:
            if sampling.whole:
                continue
            if not done:
                return _joined(machine, {}, too_large=True)
            break
        used += len(found[0])
        largest = max(largest, len(found[0]))
        if used <= sampling.words or not done:
            done[group] = run, found
    if sampling.whole:
        for group in sorted(set(range(total)) - {group for _, group in turns}):
            tell(group)
            machine.run([group])
    return _joined(machine, done, too_large=not done)


def _joined(
    machine: Machine, done: dict[int, tuple[int, tuple[Longs, Longs]]], *, too_large: bool
) -> Record:
    groups = sorted(done)
    words = [done[group][1][0] for group in groups]
    before = np.cumsum([0, *(len(each) for each in words)])
    ends = [done[group][1][1] + at for group, at in zip(groups, before, strict=False)]
    none = np.zeros(0, np.int64)
    return Record(
        words=np.concatenate([none, *words]),
        ends=np.concatenate([none, *ends]),
        groups=np.array(groups, np.int64),
        run=np.array([done[group][0] for group in groups], np.int64),
        range_start=machine.range_start,
        range_end=machine.range_end,
        too_large=too_large,
    )
