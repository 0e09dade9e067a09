from __future__ import annotations

from collections import Counter
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.router import cut_keys as module
from riot_bus.router.cut_keys import CutKeys
from riot_bus.zenoh.convert import Claims
from tests.unit.router.fake_bus import FakeBus

steps: list[Any] = []


class Forwarder:
    """Tells what it does; has messages only if its expression is `busy`."""

    def __init__(self, segment: str, expression: str, deliveries: Any, advanced: Any) -> None:
        self.segment, self.expression = segment, expression
        self.received = 3 if expression == "busy" else 0
        self.shed: Counter[str] = Counter()
        if segment == "system":
            steps.append(f"forward {expression}")

    def passed(self) -> Counter[str]:
        return Counter({self.expression: self.received})

    flows = passed

    def senders(self) -> dict[str, set[str]]:
        return {self.expression: {"ours", "theirs"}}

    def forget(self) -> None:
        pass

    def idle(self) -> bool:
        return True

    def close(self) -> None:
        if self.segment == "system":
            steps.append(f"close {self.expression}")


@pytest.fixture
def cut(monkeypatch: pytest.MonkeyPatch) -> CutKeys:
    steps.clear()
    monkeypatch.setattr(module, "Forwarder", Forwarder)
    bus = FakeBus()
    bus.deliveries.surround(claims=Claims([]))
    junction = SimpleNamespace(
        settle=lambda: steps.append("settle"), open=lambda cut, services: steps.append(f"cut {' '.join(cut)}")
    )
    network: Any = SimpleNamespace(segments=("system", "unit"), junction=junction)
    return CutKeys(network, bus.deliveries, topic=lambda key: f"/{key}", joined=lambda: steps.append("joined"))


def test_routes_are_drawn_before_what_is_cut_is_forwarded(cut: CutKeys) -> None:
    cut.cut(["a"], ["service"], again=False)
    assert steps == ["settle", "cut a", "forward a", "joined"]
    assert cut.services == ["service"]
    assert cut._deliveries.owner("a") == "a"


def test_forwarders_stay_while_any_of_their_keys_is_cut_and_end_before_the_others_begin(cut: CutKeys) -> None:
    cut.cut(["a/*", "b"], [], again=False)
    steps.clear()
    cut.cut(["a/x", "c"], [], again=True)
    assert steps == ["settle", "close b", "cut a/x c", "forward c", "joined"]
    assert cut._deliveries.owner("a/x") == "a/*"  # its former forwarder goes on
    assert cut._deliveries.owner("a/y") is None
    assert cut._deliveries.owner("b") is None


def test_while_routes_change_only_what_is_cut_before_and_after_is_forwarded(cut: CutKeys) -> None:
    owned: list[list[str | None]] = []
    cut.cut(["a", "b"], [], again=False)
    cut._network.junction.open = lambda cut_, services: owned.append(  # type: ignore[union-attr,method-assign]
        [cut._deliveries.owner(key) for key in ("a", "b", "c")]
    )
    cut.cut(["b", "c"], [], again=True)
    assert owned == [[None, "b", None]]
    assert [cut._deliveries.owner(key) for key in ("a", "b", "c")] == [None, "b", "c"]


def test_counts_of_forwarders_that_had_messages_stay(cut: CutKeys) -> None:
    cut.cut(["busy", "quiet"], [], again=False)
    assert cut.received() == 6
    cut.close()
    cut.close()
    assert steps[-2:] == ["close busy", "close quiet"]
    assert len(cut.forwarders()) == 2
    assert cut.received() == 0
    assert cut.passed() == {"/busy": 6}
    assert cut.flows() == {("busy", "system"): 3, ("busy", "unit"): 3}
    assert cut.senders({"ours"}) == {("busy", "system"): {"theirs"}, ("busy", "unit"): {"theirs"}}
    assert cut.idle()
