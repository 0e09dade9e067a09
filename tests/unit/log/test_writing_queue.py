from __future__ import annotations

import threading
from collections import Counter

import pytest

from riot_bus.log.writing_queue import Attempts, LostMessagesError, WritingQueue


def lost(number: int) -> LostMessagesError:
    return LostMessagesError("full", where="x", lost=Counter({("k", "delivered"): number}))  # type: ignore[arg-type]


def fail() -> None:
    raise OSError(28, "No space left on device")


def test_steps_are_carried_out_though_earlier_ones_fail() -> None:
    done: list[int] = []

    def step(number: int) -> None:
        done.append(number)
        raise lost(number)

    def both() -> None:
        with Attempts() as attempt:
            attempt(step, 1)
            attempt(step, 2)

    with pytest.raises(LostMessagesError) as caught:
        both()
    assert (done, caught.value.lost) == ([1, 2], {("k", "delivered"): 3})


def test_without_a_thread_an_error_is_raised_at_once() -> None:
    queue = WritingQueue("x", threaded=False, most_bytes=1, patience=0.0)
    with pytest.raises(LostMessagesError, match="No space"):
        queue.do(1, fail)
    assert (queue.errno, "No space" in queue.problem) == (28, True)
    with Attempts() as attempt:
        assert queue.has_room(10**9, attempt, patient=False)
    with pytest.raises(LostMessagesError):
        queue.sync(fail)
    queue.close()


def test_with_a_thread_errors_are_raised_by_a_later_call() -> None:
    queue = WritingQueue("x", threaded=True, most_bytes=1, patience=0.0)
    done: list[int] = []
    free = threading.Event()
    queue.do(5, free.wait)  # type: ignore[arg-type]
    queue.do(5, fail)
    queue.do(5, done.append, 1)  # type: ignore[arg-type]
    assert queue.waiting == 15
    free.set()
    with pytest.raises(LostMessagesError, match="No space"):
        queue.collect(None)
    assert (done, queue.waiting) == ([1], 0)
    queue.close()


def test_a_failed_synchronisation_is_raised_later_and_once() -> None:
    queue = WritingQueue("x", threaded=True, most_bytes=None, patience=0.0)

    def collect() -> None:
        with Attempts() as attempt:
            queue.collect_sync(attempt)

    queue.sync(fail)
    with pytest.raises(LostMessagesError):
        collect()
    collect()
    queue.close()


def test_other_errors_are_those_of_the_program() -> None:
    queue = WritingQueue("x", threaded=True, most_bytes=1, patience=0.0)
    free = threading.Event()
    queue.do(0, free.wait)  # type: ignore[arg-type]
    queue.do(0, lambda: 1 // 0)  # type: ignore[arg-type,return-value]
    free.set()
    with pytest.raises(ZeroDivisionError):
        queue.collect(None)
    queue.close()


def test_there_is_room_again_when_half_is_written() -> None:
    queue = WritingQueue("x", threaded=True, most_bytes=10, patience=0.01)
    free = threading.Event()
    queue.do(8, free.wait)  # type: ignore[arg-type]
    with Attempts() as attempt:
        assert not queue.has_room(8, attempt, patient=False)
        assert not queue.has_room(8, attempt, patient=True)
        free.set()
        queue.collect(None)
        assert queue.has_room(8, attempt, patient=True)
    queue.close()
