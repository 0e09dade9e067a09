"""What all bridges have in common."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import pytest

from riot_bus_bridges.bridging import Bridge


class Toy(Bridge):
    def __init__(self, events: list[str], *, broken: bool = False) -> None:
        super().__init__(warn=events.append)
        self.events, self.broken = events, broken

    def open(self, stack: ExitStack) -> None:
        stack.callback(self.events.append, "closed")
        if self.broken:
            raise RuntimeError("no toys")
        self.events.append("opened")

    def status(self) -> dict[str, Any]:
        return {"problems": list(self.problems)}

    def ready(self) -> str:
        return "ready"

    def summary(self) -> list[str]:
        return []


def test_a_bridge_is_open_until_it_is_left() -> None:
    events: list[str] = []
    with Toy(events) as bridge:
        assert events == ["opened"]
        assert not bridge.wait(0)
        bridge.stop()
        assert bridge.wait(0)
    assert events == ["opened", "closed"]
    assert (bridge.failure, bridge.words()) == (None, {})


def test_a_start_that_fails_leaves_nothing_open() -> None:
    events: list[str] = []
    with pytest.raises(RuntimeError), Toy(events, broken=True):
        pytest.fail("it did not start")
    assert events == ["closed"]


def test_a_problem_is_reported_once() -> None:
    events: list[str] = []
    bridge = Toy(events)
    for line in ("/a: lost", "/b: lost", "/a: lost"):
        bridge.report_problem(line)
    assert events == ["warning: /a: lost", "warning: /b: lost"]
    assert bridge.status() == {"problems": ["/a: lost", "/b: lost"]}


def test_problems_are_bounded() -> None:
    events: list[str] = []
    bridge = Toy(events)
    for number in range(1500):
        bridge.report_problem(str(number))
    assert len(events) == len(bridge.problems) == 1000


def test_a_reader_of_warnings_that_has_gone_is_no_reason_to_end() -> None:
    class Silent(Toy):
        def __init__(self) -> None:
            super().__init__([])
            self._warn = self._fail

        def _fail(self, line: str) -> None:
            raise BrokenPipeError(line)

    bridge = Silent()
    bridge.report_problem("/a: lost")
    assert list(bridge.problems) == ["/a: lost"]
