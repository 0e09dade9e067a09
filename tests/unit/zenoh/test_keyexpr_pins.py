from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import zenoh

from riot_bus.zenoh import keyexpr_pins as held_keys
from riot_bus.zenoh.keyexpr_pins import FrequentKeys, begin_pinning, end_pinning, pin


class Declaring:
    """Notes what is declared, as a session would declare it."""

    def __init__(self) -> None:
        self.declared: list[str] = []

    def declare_keyexpr(self, text: str) -> str:
        self.declared.append(text)
        return text


@pytest.fixture
def session() -> Iterator[Any]:
    made = Declaring()
    begin_pinning(made)  # type: ignore[arg-type]
    yield made
    end_pinning(made)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("expression", "numbered"),
    [
        ("a/b", {"a/b"}),
        ("a/**", {"a/**", "a"}),
        ("a/b/*/c", {"a/b/*/c", "a/b"}),
        ("a/b$*/c", {"a/b$*/c", "a"}),
        ("a/@adv/pub/**", {"a/@adv/pub/**", "a/@adv/pub"}),
        ("**", {"**"}),
    ],
)
def test_the_whole_and_the_part_before_wildcards_are_held(session: Any, expression: str, numbered: set[str]) -> None:
    pin(session, expression)
    pin(session, expression)
    assert sorted(session.declared) == sorted(numbered)


def test_those_used_last_of_too_many_are_kept(session: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(held_keys, "_MOST", 3)
    for key in "abcad":
        pin(session, key)
    assert list(held_keys._held[id(session)]) == ["c", "a", "d"]
    pin(session, "b")
    assert session.declared == ["a", "b", "c", "d", "b"]


def test_a_session_that_does_not_hold_keys_declares_none() -> None:
    other: Any = Declaring()
    pin(other, "a")
    assert other.declared == []


def test_keys_that_come_again_and_again_get_a_number(session: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(held_keys, "_MOST_FREQUENT", 3)
    frequent = FrequentKeys(session)
    for number in range(100):
        frequent.saw(zenoh.KeyExpr("often"))
        frequent.saw(zenoh.KeyExpr(f"once/{number}"))
    assert session.declared == []  # so many others came meanwhile that it was forgotten each time
    for key in "abcd":
        for _ in range(20):
            frequent.saw(zenoh.KeyExpr(key))
    assert session.declared == ["a", "b", "c"]
    another = FrequentKeys(session)
    for _ in range(20):
        another.saw(zenoh.KeyExpr("a"))
    assert session.declared == ["a", "b", "c"], "one number is enough for a session"


def test_a_number_for_a_key_ends_with_the_session(session: Any) -> None:
    frequent = FrequentKeys(session)
    end_pinning(session)
    for _ in range(20):
        frequent.saw(zenoh.KeyExpr("a"))
    assert session.declared == []
