from __future__ import annotations

import itertools
import threading
from typing import Any

import pytest

from riot_bus.pipeline.runner import AbandonedError, Pipeline
from riot_bus.router.pipeline_executor import PipelineExecutor, end_interceptors
from riot_bus.types.registry import TypeRegistry
from riot_bus.zenoh.convert import Converter, SampleArrival
from tests.unit.router.fake_bus import WAIT_S, Act, eventually, sample


class Worker:
    def __init__(self) -> None:
        self.taken = threading.Event()

    def take_over(self) -> None:
        self.taken.set()


class Blocking:
    """Blocks in one of its methods until the test lets it go on."""

    def __init__(self, hook: str) -> None:
        self.entered, self.free = threading.Event(), threading.Event()
        self.seen: list[bytes] = []
        if hook != "message":
            setattr(self, hook, self._wait)
        self._hook = hook

    def message(self, event: Any) -> None:
        self.seen.append(event.payload)
        if self._hook == "message":
            self._wait()

    def _wait(self, *_: object) -> None:
        self.entered.set()
        self.free.wait(WAIT_S)


def executor(*interceptors: object, budget_s: float = 60.0) -> PipelineExecutor:
    found = PipelineExecutor(Pipeline(interceptors, registry=TypeRegistry(())), budget_s=budget_s)
    found.start()
    return found


def feed(run: PipelineExecutor, payload: bytes = b"x", **more: Any) -> Any:
    arrival = SampleArrival(sample(payload), "cut/a", 1, Converter("system", itertools.count()))
    return run.feed("cut/a", 1, arrival=arrival, segment="system", targets=("unit",), **more)[1]


def test_a_result_says_more_than_a_new_payload() -> None:
    def act(event: Any) -> None:
        if event.payload == b"new":
            event.replace(b"newer")
        elif event.payload == b"drop":
            event.drop()

    run = executor(Act(act))
    assert feed(run, b"same") is None
    assert feed(run, b"new") is None
    assert feed(run, b"drop").dropped
    counts = run.pipeline.counts["cut/a"]
    assert (counts.seen, counts.changed, counts.dropped, counts.delivered) == (3, 1, 1, 2)
    run.close()


def test_a_worker_is_freed_from_an_interceptor_that_blocks_and_its_message_counts_once() -> None:
    blocking, worker = Blocking("message"), Worker()
    run = executor(blocking, budget_s=0.05)
    raised: list[type[Exception]] = []

    def stuck() -> None:
        try:
            feed(run, worker=worker)
        except AbandonedError as error:
            raised.append(type(error))

    thread = threading.Thread(target=stuck)
    thread.start()
    assert worker.taken.wait(WAIT_S)
    assert feed(run, worker=Worker()) is None  # another thread goes on, while this one is still stuck
    blocking.free.set()
    thread.join(WAIT_S)
    assert raised == [AbandonedError]
    assert blocking.seen == [b"x"]
    assert run.pipeline.counts["cut/a"].seen == run.pipeline.counts["cut/a"].delivered == 1
    assert run.pipeline.errors["Blocking"].count == 1
    run.close()


def test_without_a_worker_the_thread_repeats_the_message_itself() -> None:
    blocking = Blocking("message")
    run = executor(blocking, budget_s=0.05)
    letting = threading.Thread(target=lambda: (eventually(lambda: bool(run.pipeline.errors)), blocking.free.set()))
    letting.start()
    assert feed(run) is None
    letting.join(WAIT_S)
    assert run.pipeline.counts["cut/a"].seen == 1
    run.close()


def test_a_hook_that_blocks_does_not_uncount_a_message() -> None:
    blocking = Blocking("joined")
    run = executor(blocking, budget_s=0.05)
    assert feed(run) is None
    stage = run.pipeline.stages[0]
    worker = Worker()
    raised: list[bool] = []

    def stuck() -> None:
        try:
            run.call(stage, "joined", "component", worker=worker)
        except AbandonedError:
            raised.append(True)

    thread = threading.Thread(target=stuck)
    thread.start()
    assert worker.taken.wait(WAIT_S)
    blocking.free.set()
    thread.join(WAIT_S)
    assert raised == [True]
    assert run.pipeline.counts["cut/a"].seen == 1
    run.close()


def test_a_hook_of_an_interceptor_that_was_removed_is_not_called() -> None:
    calls: list[object] = []

    class Joined(Act):
        def joined(self, component: object) -> None:
            calls.append(component)

    first = Joined(lambda event: None)
    run = executor(first)
    stage = run.pipeline.stages[0]
    run.call(stage, "joined", 1, worker=Worker())
    run.replace([])
    run.call(stage, "joined", 2, worker=Worker())
    assert calls == [1]
    run.close()


def test_an_interceptor_that_cannot_say_what_it_makes_of_payloads_is_asked_for_each_message(
    caplog: pytest.LogCaptureFixture,
) -> None:
    class Broken(Act):
        def rewriter(self, kind: object, key: str, payload: bytes) -> object:
            raise ValueError("on purpose")

    run = executor(Broken(lambda event: None))
    run.pipeline.provenance = False
    run.change(Pipeline.start)
    assert run.rewriter("cut/a", b"x") is None
    assert "on purpose" in caplog.text
    run.close()


def test_rewritten_messages_are_counted_as_changed() -> None:
    run = executor()
    run.rewrote("cut/a", 3)
    counts = run.pipeline.counts["cut/a"]
    assert (counts.seen, counts.changed, counts.delivered) == (3, 3, 3)
    run.close()
    run.close()


def test_interceptors_that_do_not_stop_are_left_behind() -> None:
    blocking, stopped = Blocking("stop"), threading.Event()

    class Last(Act):
        def stop(self) -> None:
            stopped.set()

    pipeline = Pipeline([blocking, Last(lambda event: None)], registry=TypeRegistry(()))
    pipeline.start()
    end_interceptors(pipeline, patience_s=0.05)
    blocking.free.set()
    assert stopped.is_set()
    assert "did not stop" in pipeline.errors["Blocking"].first
