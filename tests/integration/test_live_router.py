from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from riot_bus.testing.live_router import LiveRouter, RouterTest
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Injection
from riot_bus.zenoh.session import wait_until

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def router() -> Iterator[LiveRouter]:
    with LiveRouter(["a", "b"], registry=TypeRegistry()) as one:
        yield one


@pytest.fixture
def one(router: LiveRouter, tmp_path: Path) -> Iterator[RouterTest]:
    with router.test(folder=tmp_path, out=tmp_path / "out") as test:
        yield test


def test_who_records_everything_is_no_subscriber(router: LiveRouter, one: RouterTest) -> None:
    with pytest.raises(AssertionError, match=r"nobody in segment 'b' has subscribed to x in 0.3 s"):
        one.wait_subscribed("x", segment="b", timeout=0.3)
    heard = []
    with router.segment("b").open() as session:
        subscriber = session.declare_subscriber("x", lambda sample: heard.append(sample.payload.to_bytes()))
        for number in range(5):
            one.wait_subscribed("x", segment="b", timeout=30)
            one.put("x", {"n": number})
        assert wait_until(lambda: len(heard) == 5, 30)
        subscriber.undeclare()
    assert [each.read("n") for each in one.record.wait_for("x", 5, timeout=30)] == list(range(5))
    assert one.problems() == []


@pytest.mark.parametrize("time", range(2))
def test_each_test_begins_anew(router: LiveRouter, one: RouterTest, time: int) -> None:
    one.inject(Injection("y", "n", 9, first=1, last=1))
    for number in range(3):
        one.put("y", {"n": number})
    assert [each.read("n") for each in one.record.wait_for("y", 3, timeout=30)] == [0, 9, 2]
    assert [each.read("n") for each in one.sent("y")] == [0, 1, 2]
    counts = one.counts()["y"]
    assert (counts.received, counts.changed, counts.forwarded, counts.recorded) == (3, 1, 3, 3)
    assert one.problems() == []


def test_afterwards_nothing_is_intercepted_or_kept(router: LiveRouter, tmp_path: Path) -> None:
    with router.test(folder=tmp_path, out=tmp_path) as before:
        before.interceptor("drop select=z")
        before.put("z", b"1")
        assert wait_until(lambda: before.counts().get("z") is not None, 30)
        assert before.counts()["z"].dropped == 1
    assert router.bus.intercepted == []
    assert before.record.sent("z") == []
    with router.test(folder=tmp_path, out=tmp_path) as after:
        after.put("z", b"1")
        after.record.wait_for("z", timeout=30)
        assert after.counts()["z"].dropped == 0


def test_problems_name_what_has_not_happened(one: RouterTest) -> None:
    one.interceptor(lambda event: None)
    one.inject(Injection("u", "n", 1))
    one.intercept("v")
    one.put("u", {"m": 1})
    one.record.wait_for("u", timeout=30)
    assert one.problems() == ["injection 0 (set of u:n) was not carried out", "no message of v was intercepted"]


def test_a_router_is_reached_as_its_variables_say(router: LiveRouter) -> None:
    unit = router.segment("b")
    settings = json.loads(unit.config_file.read_text())
    assert settings["connect"]["endpoints"] == [unit.endpoint]
    assert unit.variables["ZENOH_CONFIG"] == str(unit.config_file)
    with pytest.raises(ConfigError, match="no segment 'c'"):
        router.segment("c")
