from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from riot_bus.zenoh.scouting import Answer, Scouting, scout


class Config:
    """A configuration that can be looked at."""

    def __init__(self) -> None:
        self.values: dict[str, Any] = {}

    def insert_json5(self, key: str, text: str) -> None:
        self.values[key.removeprefix("scouting/multicast/")] = json.loads(text)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """What was asked; on each interface, the same two sessions answer."""
    asked: list[dict[str, Any]] = []

    def answer(take: Any, *, what: str, config: Config) -> Any:
        asked.append(config.values | {"what": what})
        for zid, mode in (("b", "router"), ("a", "peer")):
            take(SimpleNamespace(zid=zid, whatami=mode, locators=[f"tcp/{config.values['interface']}"]))
        return SimpleNamespace(stop=lambda: asked.append({"stop": config.values["interface"]}))

    monkeypatch.setattr(zenoh, "Config", Config)
    monkeypatch.setattr(zenoh, "scout", answer)
    return asked


def test_each_session_is_known_by_its_first_answer(asked: list[dict[str, Any]]) -> None:
    found = scout(Scouting(("lo", "eth0"), listen_s=0.0))
    assert list(found.items()) == [
        ("a", Answer("a", "peer", ("tcp/lo",), "lo")),
        ("b", Answer("b", "router", ("tcp/lo",), "lo")),
    ]
    same = {"address": "224.0.0.224:7446", "ttl": 0, "what": "router|peer|client"}
    assert asked[:2] == [same | {"interface": "lo"}, same | {"interface": "eth0"}]
    assert asked[2:] == [{"stop": "lo"}, {"stop": "eth0"}]


def test_when_all_that_are_sought_have_answered_nothing_is_waited_for(
    asked: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(condition: object, seconds: float) -> None:
        raise AssertionError("waited")

    monkeypatch.setattr("threading.Condition.wait", never)
    assert set(scout(Scouting(("lo",), listen_s=60.0), until=["a", "b"])) == {"a", "b"}
    with pytest.raises(AssertionError, match="waited"):
        scout(Scouting(("lo",), listen_s=60.0), until=["a", "c"])
