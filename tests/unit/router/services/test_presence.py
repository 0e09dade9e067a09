from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.router.services.presence import Presence
from riot_bus.zenoh import libraries

LIBRARY = SimpleNamespace(
    QueryTarget=SimpleNamespace(ALL_COMPLETE="complete", BEST_MATCHING="any"),
    Locality=SimpleNamespace(REMOTE="remote"),
    handlers=SimpleNamespace(Callback=lambda call, indirect: call),
)


class Declared:
    """A querier or a queryable of a segment; what it matches depends on the services that others have there."""

    def __init__(self, session: Session, expression: str, *, complete: bool) -> None:
        self.session, self.expression, self.complete = session, expression, complete
        session.declared.append(self)

    @property
    def matching_status(self) -> Any:
        there = {complete for key, complete in self.session.services if key == self.expression}
        return SimpleNamespace(matching=True in there if self.complete else bool(there))

    def declare_matching_listener(self, heard: Any) -> Any:
        self.session.heard.append(heard)
        return SimpleNamespace(undeclare=lambda: self.session.heard.remove(heard))

    def undeclare(self) -> None:
        self.session.declared.remove(self)


class Session:
    def __init__(self) -> None:
        self.services: set[tuple[str, bool]] = set()
        self.declared: list[Declared] = []
        self.heard: list[Any] = []
        self.stand_ins: list[bool] = []

    def declare_querier(self, expression: str, *, target: str, allowed_destination: str) -> Declared:
        assert allowed_destination == "remote"
        return Declared(self, expression, complete=target == "complete")

    def declare_queryable(self, expression: str, take: Any, *, complete: bool, allowed_origin: str) -> Any:
        assert allowed_origin == "remote"  # else a router would get its own questions
        self.stand_ins.append(complete)
        return SimpleNamespace(undeclare=lambda: self.stand_ins.remove(complete))

    def serve(self, key: str, *, complete: bool = False) -> None:
        self.services.add((key, complete))
        for heard in self.heard:
            heard(None)

    def stop(self) -> None:
        self.services.clear()
        for heard in self.heard:
            heard(None)


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.setitem(libraries._by_type, Session, LIBRARY)
    return {"system": Session(), "unit": Session()}


def presence(network: dict[str, Any], expression: str, *, served: bool = False) -> Presence:
    worker: Any = SimpleNamespace(do=lambda job: job())
    take: Any = dict.fromkeys(network, lambda query: None)
    made = Presence(expression, network, take, served=served, worker=worker)
    made.open()
    return made


def test_a_stand_in_is_in_the_other_segments_as_long_as_the_service_exists(network: dict[str, Any]) -> None:
    presence(network, "add")
    assert network["unit"].stand_ins == network["system"].stand_ins == []
    network["unit"].serve("add")
    assert (network["system"].stand_ins, network["unit"].stand_ins) == ([False], [])
    network["unit"].stop()
    assert network["system"].stand_ins == []


def test_the_stand_in_of_a_wildcard_is_always_there_and_complete_if_a_service_is(network: dict[str, Any]) -> None:
    presence(network, "robot/**")
    assert network["system"].stand_ins == network["unit"].stand_ins == [False]
    network["unit"].serve("robot/**", complete=True)
    assert (network["system"].stand_ins, network["unit"].stand_ins) == ([True], [False])


def test_stand_ins_of_served_keys_are_complete_from_the_beginning(network: dict[str, Any]) -> None:
    served = presence(network, "add", served=True)
    assert network["system"].stand_ins == network["unit"].stand_ins == [True]
    network["unit"].serve("add")
    assert served.asked("system", "add") == {"unit": False}
    network["unit"].serve("add", complete=True)
    assert served.asked("system", "add") == {"unit": True}


def test_only_segments_with_such_a_service_are_asked(network: dict[str, Any]) -> None:
    robots = presence(network, "robot/**")
    network["unit"].serve("robot/add")
    assert robots.asked("system", "robot/add") == {"unit": False}
    assert robots.asked("unit", "robot/add") == {}
    assert robots.asked("system", "robot/other") == {}
    assert robots.asked("system", "robot/*") == {"unit": False}


def test_nothing_is_left_after_the_end(network: dict[str, Any]) -> None:
    robots = presence(network, "robot/**")
    robots.asked("system", "robot/add")
    robots.close()
    robots.close()
    robots.update()
    assert robots.asked("system", "robot/add") == {}
    assert all((each.declared, each.heard, each.stand_ins) == ([], [], []) for each in network.values())
