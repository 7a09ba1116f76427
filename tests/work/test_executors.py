"""Executors: results in order, kept as they come, and errors that say which unit."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from itertools import pairwise

import pytest

from gibench.errors import BadInput, GibenchError
from gibench.work import Serial, Threads, Worker, run_in_order

EXECUTORS = [Serial(), Threads(1), Threads(3), Threads()]


@dataclass(frozen=True)
class Number:
    value: int

    @property
    def name(self) -> str:
        return f"number {self.value}"


NUMBERS = [Number(n) for n in range(20)]


def halve(common: float, unit: Number, worker: Worker) -> float:
    time.sleep(0.001 * (unit.value % 3))
    return unit.value * common


@pytest.mark.parametrize("executor", EXECUTORS, ids=str)
def test_results_are_in_order_and_told_in_the_calling_thread(executor):
    told = {}

    def done(unit, result):
        assert threading.current_thread() is threading.main_thread()
        told[unit.value] = result

    results = executor.run(halve, 0.5, iter(NUMBERS), done)
    assert results == [n / 2 for n in range(20)]
    assert told == {n: n / 2 for n in range(20)}


def refuse(common: BaseException, unit: Number, worker: Worker) -> int:
    if unit.value == 4:
        raise common
    time.sleep(0.02)
    return unit.value


@pytest.mark.parametrize("executor", EXECUTORS, ids=str)
def test_our_errors_keep_their_kind_and_say_the_unit(executor):
    told = []
    wrong = BadInput("no light", where="here", mend="add one")
    with pytest.raises(BadInput, match="here: number 4: no light; add one") as caught:
        executor.run(refuse, wrong, NUMBERS, lambda unit, result: told.append(unit.value))
    assert isinstance(caught.value, GibenchError)
    assert set(told) >= {0, 1, 2, 3}
    assert len(told) < 20


@pytest.mark.parametrize("executor", EXECUTORS, ids=str)
def test_other_errors_are_the_same_with_a_note(executor):
    with pytest.raises(ZeroDivisionError) as caught:
        executor.run(refuse, ZeroDivisionError("oh"), NUMBERS)
    assert caught.value.__notes__ == ["in number 4"]


def interrupted(common: None, unit: Number, worker: Worker) -> int:
    if unit.value == 1:
        time.sleep(0.05)
    return unit.value


def test_an_interrupt_leaves_what_was_under_way_finished_and_told():
    told = []

    def done(unit, result):
        told.append(unit.value)
        if unit.value == 0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Threads(2).run(interrupted, None, NUMBERS, done)
    assert sorted(told) == [0, 1]
    told.clear()
    with pytest.raises(KeyboardInterrupt):
        Serial().run(interrupted, None, NUMBERS, done)
    assert told == [0]


def test_units_are_taken_no_sooner_than_a_thread_is_free():
    taken, ended = [], []

    def units():
        for number in NUMBERS:
            taken.append(number)
            assert len(taken) - len(ended) <= 2
            yield number

    Threads(2).run(halve, 1.0, units(), lambda unit, result: ended.append(unit))
    assert taken == NUMBERS


def resources(common: list, unit: Number, worker: Worker) -> tuple[object, object]:
    def make() -> object:
        common.append(threading.get_ident())
        return object()

    time.sleep(0.002)
    return worker.own("queue", make), worker.shared("context", make)


def test_a_worker_keeps_its_own_things_and_shares_the_others():
    made: list[int] = []
    found = Threads(3).run(resources, made, NUMBERS)
    own, shared = ({id(pair[i]) for pair in found} for i in (0, 1))
    assert len(shared) == 1
    assert 1 <= len(own) <= 3
    assert len(made) == len(own) + 1
    made.clear()
    Serial().run(resources, made, NUMBERS)
    assert len(made) == 2


def test_no_threads_are_refused():
    with pytest.raises(ValueError, match="1 or more"):
        Threads(0)


def timed_alone(common: list, unit: Number, worker: Worker) -> int:
    """Work beside others, then alone, then beside others again; tells when."""
    with_others = time.perf_counter()
    time.sleep(0.002 * (unit.value % 4))
    with worker.alone():
        begin = time.perf_counter()
        time.sleep(0.003)
        common.append(("alone", begin, time.perf_counter()))
    common.append(("beside", with_others, begin))
    after = time.perf_counter()
    time.sleep(0.002)
    common.append(("beside", after, time.perf_counter()))
    return unit.value


@pytest.mark.parametrize("executor", EXECUTORS, ids=str)
def test_one_that_asks_to_be_alone_is_alone(executor):
    """Nobody else is alone meanwhile, and nobody begins or ends anything beside it."""
    spans: list[tuple[str, float, float]] = []
    asked: list[float] = []

    def done(unit, result):
        asked.append(time.perf_counter())

    assert executor.run(timed_alone, spans, NUMBERS, done) == list(range(20))
    alone = sorted(span[1:] for span in spans if span[0] == "alone")
    assert len(alone) == 20
    assert all(end <= begin for (_, end), (begin, _) in pairwise(alone))
    others = [span[1:] for span in spans if span[0] == "beside"]
    for moment in [m for span in others for m in span] + asked:
        assert not any(begin < moment < end for begin, end in alone)


@pytest.mark.parametrize("executor", EXECUTORS, ids=str)
def test_results_are_told_in_order_where_that_is_asked(executor):
    told = []
    run_in_order(executor, halve, 1.0, NUMBERS, lambda unit, result: told.append(unit.value))
    assert told == list(range(20))


def test_what_is_finished_is_told_in_order_when_another_fails():
    told: list[int] = []

    def keep(unit: Number, result: int) -> None:
        told.append(unit.value)

    with pytest.raises(BadInput, match="number 4"):
        run_in_order(Threads(3), refuse, BadInput("no light"), NUMBERS, keep)
    assert told == sorted(told) and set(told) >= {0, 1, 2, 3} and 4 not in told

    def full(unit: Number, result: int) -> None:
        told.append(unit.value)
        raise GibenchError("the disk is full")

    told.clear()
    with pytest.raises(GibenchError, match="the disk is full"):
        run_in_order(Threads(3), halve, 1.0, NUMBERS, full)
    assert told == [0]  # who cannot write is not asked again
