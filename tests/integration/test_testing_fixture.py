from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from riot_bus.testing.fixture import RouterTest, router_test
from riot_bus.testing.live_router import LiveRouter
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
    with router_test(router, folder=tmp_path, out=tmp_path / "out") as test:
        yield test


def subscriber(router: LiveRouter, segment: str, key: str, heard: list[bytes]) -> Any:
    session = router.segment(segment).open()
    session.declare_subscriber(key, lambda sample: heard.append(sample.payload.to_bytes()))
    return session


@pytest.mark.parametrize("expression", ["x", "**"])
def test_who_records_everything_is_no_subscriber(router: LiveRouter, one: RouterTest, expression: str) -> None:
    with pytest.raises(AssertionError, match=r"no component in segment 'b' has subscribed to x in 0.3 s"):
        one.wait_subscribed("x", timeout=0.3)
    heard: list[bytes] = []
    with subscriber(router, "b", expression, heard):
        for number in range(5):
            one.wait_subscribed("x", timeout=30)
            one.put("x", {"n": number})
        assert wait_until(lambda: len(heard) == 5, 30)
    assert [each.read("n") for each in one.record.wait_for("x", 5, timeout=30)] == list(range(5))
    assert one.problems() == []


def test_a_subscriber_elsewhere_does_not_count(router: LiveRouter, one: RouterTest) -> None:
    with subscriber(router, "a", "x", []), pytest.raises(AssertionError, match="no component in segment 'b'"):
        one.wait_subscribed("x", timeout=0.5)


@pytest.mark.parametrize("time", range(2))
def test_each_test_begins_anew(router: LiveRouter, one: RouterTest, time: int) -> None:
    with subscriber(router, "b", "y", []):
        one.wait_subscribed("y", timeout=30)
        one.inject(Injection("y", "n", 9, first=1, last=1))
        for number in range(3):
            one.put("y", {"n": number})
        assert [each.read("n") for each in one.record.wait_for("y", 3, timeout=30)] == [0, 9, 2]
    assert [each.read("n") for each in one.sent("y")] == [0, 1, 2]
    counts = one.counts()["y"]
    assert (counts.received, counts.changed, counts.forwarded, counts.recorded) == (3, 1, 3, 3)
    assert one.problems() == []


def test_afterwards_nothing_is_intercepted_kept_or_delayed(router: LiveRouter, tmp_path: Path) -> None:
    with router_test(router, folder=tmp_path, out=tmp_path) as before:
        before.interceptor("drop select=z")
        before.interceptor("delay seconds=3600 select=late")
        before.put("z", b"1")
        before.put("late", b"1")
        assert wait_until(lambda: len(before.counts()) == 2, 30)
        assert before.counts()["z"].dropped == 1
        assert "1 message of late still delayed, and given up now" in before.problems()
    assert before.record.sent("z") == []
    with router_test(router, folder=tmp_path, out=tmp_path) as after:
        after.put("z", b"1")
        after.record.wait_for("z", timeout=30)
        assert set(after.counts()) == {"z"}
        assert after.counts()["z"].dropped == 0
        assert after.problems() == []


def test_problems_name_what_has_not_happened(router: LiveRouter, one: RouterTest) -> None:
    one.interceptor(lambda event: None)
    one.interceptor("drop every=2 select=typo")
    one.inject(Injection("u", "n", 1))
    one.inject(Injection("u", "m", 1, where="m > 5"), Injection("u", "m", 2))
    one.intercept("v", "w")
    with subscriber(router, "b", "u", []), subscriber(router, "a", "w", []):
        one.wait_subscribed("u", timeout=30)
        one.wait_subscribed("w", segment="a", timeout=30)
        one.put("u", {"m": 1})
        one.put("w", {"m": 1})
        one.record.wait_for("*", 2, timeout=30)
    assert one.problems() == [
        "interceptor drop saw nothing: none of typo came",
        "injection 0 (set of u:n) was not carried out: no field 'n'",
        "injection 1 (set of u:m) was not carried out",
        "messages of v: none was intercepted",
        "messages of w: they came from segment a, and subscribers are in a; between processes of one segment riot sees "
        "nothing",
    ]


def test_what_is_refused_changes_nothing(one: RouterTest) -> None:
    for given in (print, 5, object):
        if given is not print:
            with pytest.raises(ConfigError, match="is not an interceptor"):
                one.interceptor(given)

    async def later(event: object) -> None:
        pass

    with pytest.raises(ConfigError, match="is not an interceptor"):
        one.interceptor(later)
    with pytest.raises(ConfigError):
        one.intercept("a:b c")
    with pytest.raises(ConfigError, match="is not a single key"):
        one.put("a/*", {})
    with pytest.raises(ConfigError, match="cannot read the injection plan"):
        one.inject("missing.toml")
    assert one.problems() == []


def test_the_seed_reaches_all_that_is_drawn(router: LiveRouter, tmp_path: Path) -> None:
    found = []
    for seed in (0, 7, 7):
        with router_test(router, folder=tmp_path, out=tmp_path, seed=seed) as one:
            one.interceptor("drop probability=0.5 select=d", required=False)
            for number in range(30):
                one.put("d", {"n": number})
            assert wait_until(lambda one=one: one.counts()["d"].received == 30, 30)
            found.append([each.read("n") for each in one.delivered("d")])
    assert found[0] != found[1] == found[2]


def test_a_process_that_dies_is_a_problem_and_none_outlives_its_test(router: LiveRouter, tmp_path: Path) -> None:
    with router_test(router, folder=tmp_path, out=tmp_path) as one:
        stays = one.start([sys.executable, "-c", "import threading; threading.Event().wait()"])
        ends = one.start([sys.executable, "-c", "raise SystemExit(3)"])
        assert ends.wait(30) == 3
        assert stays.status is None
        (told,) = one.problems()
        assert told.endswith("has ended with status 3")
        with pytest.raises(
            AssertionError, match="no component in segment 'b' has subscribed to p before the process ended"
        ):
            one.start([sys.executable, "-c", ""], subscribes=["p"])
        process = psutil.Process(stays.pid)
    assert not process.is_running()
