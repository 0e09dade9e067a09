from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import pytest

from riot_bus.pipeline.runner import AbandonedError
from riot_bus.router.worker import Worker
from riot_bus.zenoh.session import wait_until

NAME = "riot-test-worker"


@pytest.fixture
def worker() -> Iterator[Worker]:
    made = Worker(NAME)
    yield made
    made.close()
    made.close()
    assert wait_until(lambda: all(each.name != NAME for each in threading.enumerate()), 20)


def finish(worker: Worker) -> None:
    done = threading.Event()
    worker.do(done.set)
    assert done.wait(20)


def test_jobs_are_done_in_order_by_one_thread(worker: Worker) -> None:
    done: list[int] = []
    threads: set[int] = set()

    def job(number: int) -> Callable[[], None]:
        def run() -> None:
            threads.add(threading.get_ident())
            done.append(number)

        return run

    for number in range(100):
        worker.do(job(number))
    finish(worker)
    assert done == list(range(100))
    assert len(threads) == 1
    assert threads != {threading.get_ident()}


def test_jobs_for_later_are_done_in_the_order_of_their_times(worker: Worker) -> None:
    done: list[str] = []
    last = threading.Event()
    worker.later(0.05, last.set)
    worker.later(0.03, lambda: done.append("second"))
    worker.later(0.01, lambda: done.append("first"))
    worker.do(lambda: done.append("at once"))
    assert last.wait(20)
    assert done == ["at once", "first", "second"]


def test_it_is_idle_when_nobody_waits_for_a_job(worker: Worker) -> None:
    go_on = threading.Event()

    def job() -> None:
        go_on.wait(20)

    worker.later(3600, lambda: None, background=True)
    assert wait_until(worker.idle, 20)
    worker.do(job)
    assert not worker.idle()
    go_on.set()
    assert wait_until(worker.idle, 20)
    worker.later(3600, lambda: None)
    assert not worker.idle()


def test_a_job_that_fails_is_told_and_the_next_one_is_done(worker: Worker, caplog: pytest.LogCaptureFixture) -> None:
    def fail() -> None:
        raise ValueError("on purpose")

    worker.do(fail)
    finish(worker)
    assert "on purpose" in caplog.text
    assert wait_until(worker.idle, 20)


def test_another_thread_does_a_job_again_that_is_stuck(worker: Worker) -> None:
    stuck, let_go = threading.Event(), threading.Event()
    done: list[str] = []

    def job() -> None:
        if not stuck.is_set():
            stuck.set()
            let_go.wait(20)
            raise AbandonedError("too late")
        done.append("job")

    worker.do(job)
    worker.do(lambda: done.append("next"))
    assert stuck.wait(20)
    assert not worker.idle()
    worker.take_over()
    finish(worker)
    assert done == ["job", "next"]
    let_go.set()
    assert wait_until(lambda: sum(each.name == NAME for each in threading.enumerate()) == 1, 20)
    finish(worker)
    assert done == ["job", "next"]
    assert worker.idle()


def test_closing_does_what_is_to_be_done_at_once_and_nothing_later() -> None:
    worker, done = Worker(NAME), list[str]()
    worker.later(3600, lambda: done.append("later"))
    for _ in range(10):
        worker.do(lambda: done.append("now"))
    worker.close()
    assert done == ["now"] * 10
