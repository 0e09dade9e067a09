"""How long the answer of a worker is waited for, once Dask says that it is there."""

from __future__ import annotations

from typing import Any

import pytest

from riot_bus_cluster.workers import _ClusterWorker


class Late:
    """A future whose result comes after some timeouts, if at all."""

    def __init__(self, worker: _ClusterWorker, *, after: int = 10**9, status: str = "finished", leaves: bool = False):
        self.worker, self.after, self.status, self.leaves = worker, after, status, leaves
        self.asked = 0

    def result(self, timeout: float) -> bytes:
        """Raise as Dask does when time is up; the worker may leave meanwhile."""
        assert timeout > 0
        self.asked += 1
        if self.asked > self.after:
            return b"answer"
        if self.leaves:
            self.worker.leave()
        raise TimeoutError


def worker() -> _ClusterWorker:
    nobody: Any = None
    return _ClusterWorker(nobody, "tcp://127.0.0.1:1", "name")


def test_a_large_answer_is_waited_for_while_its_worker_is_there() -> None:
    one = worker()
    future: Any = Late(one, after=3)
    assert (one._result(future), future.asked) == (b"answer", 4)


@pytest.mark.parametrize("why", [{"leaves": True}, {"status": "error"}], ids=["left", "raised by the case"])
def test_an_answer_that_cannot_come_ends_the_wait(why: dict[str, Any]) -> None:
    one = worker()
    future: Any = Late(one, **why)
    with pytest.raises(TimeoutError):
        one._result(future)
    assert future.asked == 1
