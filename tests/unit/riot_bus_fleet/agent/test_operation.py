from __future__ import annotations

import threading
from contextlib import ExitStack
from typing import Any

import pytest

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, RiotError
from riot_bus.zenoh.session import wait_until
from riot_bus_fleet.agent.operation import FINAL, Operation
from riot_bus_fleet.agent.request import Lead

LEAD = Lead(operation="0" * 16, on_lost_controller="continue", who="ann")


class Service:
    """A service that goes on when the test says so."""

    def __init__(self, go: threading.Event) -> None:
        self._go = go
        self.done: list[str] = []

    def start(self) -> None:
        self.done.append("start")

    def pause(self) -> None:
        self.done.append("pause")

    def resume(self) -> None:
        self.done.append("resume")

    def stop(self) -> None:
        self._go.set()

    def close(self) -> None:
        self.done.append("close")

    def wait(self, timeout: float | None = None) -> bool:
        return self._go.wait(timeout)


class Steps(Operation[Service]):
    """An operation that goes on when the test says so."""

    kind = "step"

    def __init__(self, error: Exception | None = None) -> None:
        self.states: list[str] = []
        super().__init__(LEAD, self._note)
        self.inner = {"state": "playing"}
        self.go = threading.Event()
        self._error = error

    def _note(self) -> None:
        self.states.append(self.status()["state"])

    def _open(self, stack: ExitStack) -> Service:
        self.service = Service(self.go)
        return self.service

    def _row(self, service: Service) -> dict[str, Any]:
        return self.inner

    def _result(self, service: Service) -> dict[str, Any]:
        if self._error is not None:
            raise self._error
        return {"published": 1}

    def begin(self) -> None:
        self.start()
        assert wait_until(lambda: self._details() is not None, 30)


def test_it_is_not_over_before_the_result_is_there() -> None:
    steps = Steps()
    steps.begin()
    assert steps.status()["state"] == "playing"
    steps.inner = {"state": "ended"}
    assert (steps.status()["state"], steps.active) == ("stopping", True)
    steps.go.set()
    assert steps.wait(30)
    found = steps.status()
    assert (found["state"], found["result"], found["problem"], steps.active) == ("ended", {"published": 1}, None, False)


def test_a_stop_says_why_and_the_first_reason_counts() -> None:
    steps = Steps()
    steps.begin()
    steps.stop("stopped by ann")
    steps.stop("stopped by bob")
    assert steps.wait(30)
    assert (steps.status()["state"], steps.status()["reason"]) == ("stopped", "stopped by ann")
    assert steps.states[0] == "playing"
    assert steps.states[1] in ("stopping", *FINAL)


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (ConfigError("no such topic", where="x", hint="y"), 2, "no such topic"),
        (RiotError("m" * 10_000), 2, "m" * 2000),
        (ValueError("oops"), 1, "failure of ours: ValueError('oops')"),
    ],
)
def test_a_failure_is_a_state(error: Exception, code: int, message: str) -> None:
    steps = Steps(error)
    steps.begin()
    steps.go.set()
    assert steps.wait(30)
    status = steps.status()
    assert (status["state"], status["problem"]["exit_code"], status["problem"]["message"]) == ("failed", code, message)


def test_warnings_are_bounded() -> None:
    steps = Steps()
    for number in range(100):
        steps.warn(f"{number} " + "x" * 10_000)
    assert len(steps.status()["warnings"]) == 20
    assert max(map(len, steps.status()["warnings"])) == 500


def test_a_pause_goes_to_the_service() -> None:
    steps = Steps()
    with pytest.raises(EnvironmentFaultError, match="the step has not begun yet"):
        steps.pause()
    steps.begin()
    steps.pause()
    steps.resume()
    steps.stop("enough")
    with pytest.raises(EnvironmentFaultError, match="has ended"):
        steps.resume()
    assert steps.wait(30)
    assert steps.service.done == ["start", "pause", "resume", "close"]


def test_what_it_cannot_do() -> None:
    steps = Steps()
    for do in (lambda: steps.seek(1.0), lambda: steps.set_rate(1.0)):
        with pytest.raises(ConfigError, match="a step has no command "):
            do()
