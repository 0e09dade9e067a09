from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.router import interception as module
from riot_bus.router.interception import Interception, topics_of
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError


class Bus:
    """Keeps what it is told; refuses what the test says."""

    def __init__(self) -> None:
        self.calls: list[Any] = []
        self.refuses: str | None = None

    def set_intercept(self, expressions: list[str], *, services: list[str]) -> None:
        self.calls.append((list(expressions), list(services)))
        if self.refuses in expressions:
            raise EnvironmentFaultError("on purpose")

    def set_interceptors(self, interceptors: list[object]) -> None:
        self.calls.append([getattr(each, "name", "?") for each in interceptors])


class Wants:
    """An interceptor of some topics."""

    def __init__(self, *topics: str) -> None:
        self.topics = topics


def plan(*topics: str) -> Any:
    injector = Wants(*topics)
    return SimpleNamespace(injector=SimpleNamespace(topics=injector.topics, name="injector", ended=lambda: False))


def interception(bus: Bus, *keys: str, interceptors: tuple[object, ...] = (), plan: Any = None) -> Interception:
    return Interception(
        lambda: bus,  # type: ignore[arg-type,return-value]
        keys=keys,
        interceptors=interceptors,
        plan=plan,
        registry=TypeRegistry(()),
    )


def test_keys_of_user_interceptors_and_plan_are_intercepted_once() -> None:
    found = interception(Bus(), "a/*", "a/*", interceptors=(Wants("a/b", "c"),), plan=plan("d"))
    assert found.topics == ["a/*", "a/b", "c", "d"]
    assert sorted(found.expressions) == ["a/*", "c", "d"]
    assert found.services == []


def test_an_interceptor_that_takes_everything_needs_a_key() -> None:
    with pytest.raises(ConfigError, match="would see nothing"):
        interception(Bus(), interceptors=(object(),))
    assert topics_of(object()) is None
    assert topics_of(Wants("a")) == ["a"]


def test_routes_change_only_where_they_must() -> None:
    bus = Bus()
    found = interception(bus, "a/*")
    assert found.add(["a/b"]) == ["a/*"]
    assert bus.calls == []
    assert found.add(["c"]) == ["a/*", "c"]
    assert found.remove(["a/*"]) == ["c", "a/b"]
    assert [call[0] for call in bus.calls] == [["a/*", "c"], ["c", "a/b"]]


def test_only_the_users_own_keys_can_be_removed() -> None:
    found = interception(Bus(), "a", interceptors=(Wants("b"),))
    with pytest.raises(ConfigError, match="not intercepted on your account") as refused:
        found.remove(["b"])
    assert "an interceptor or the plan wants it" in str(refused.value.hint)
    with pytest.raises(ConfigError, match="no key expression is given"):
        found.add([])


def test_a_plan_comes_and_goes_with_its_topics() -> None:
    bus, ended = Bus(), plan("b")
    found = interception(bus, "a")
    assert found.set_plan(ended) == ["a", "b"]
    assert bus.calls == [["injector"], (["a", "b"], [])]
    ended.injector.ended = lambda: True
    assert found.plan is None
    assert found.topics == ["a"]
    assert found.set_plan(None) == ["a"]


def test_after_a_refused_change_everything_is_as_before() -> None:
    bus = Bus()
    found = interception(bus, "a")
    bus.refuses = "b"
    with pytest.raises(EnvironmentFaultError):
        found.set_plan(plan("b"))
    assert bus.calls == [["injector"], (["a", "b"], []), [], (["a"], [])]
    assert (found.keys, found.plan, found.expressions) == (["a"], None, ["a"])


def test_services_are_told_from_topics() -> None:
    found = interception(Bus(), "a", "add/@request")
    assert (found.expressions, found.services) == (["a"], ["add"])
    assert found.intercepted == ["a", "add/@request"]


@pytest.mark.parametrize("key", ["@riot/router", "@/session"])
def test_what_routers_tell_each_other_is_not_intercepted(key: str) -> None:
    with pytest.raises(ConfigError, match="cannot be intercepted"):
        interception(Bus(), key)


def test_there_is_a_bound_for_keys_and_their_length(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_KEYS", 2)
    with pytest.raises(ConfigError, match="more than 2 key expressions"):
        interception(Bus(), "a", "b", "c")
    with pytest.raises(ConfigError, match="longer than"):
        interception(Bus(), "a" * 2000)
