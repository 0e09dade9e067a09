from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from riot_bus.bus import held_keys
from riot_bus.bus.held_keys import begin_holding, end_holding, hold


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
    begin_holding(made)  # type: ignore[arg-type]
    yield made
    end_holding(made)  # type: ignore[arg-type]


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
    hold(session, expression)
    hold(session, expression)
    assert sorted(session.declared) == sorted(numbered)


def test_those_used_last_of_too_many_are_kept(session: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(held_keys, "_MOST", 3)
    for key in "abcad":
        hold(session, key)
    assert list(held_keys._held[id(session)]) == ["c", "a", "d"]
    hold(session, "b")
    assert session.declared == ["a", "b", "c", "d", "b"]


def test_a_session_that_does_not_hold_keys_declares_none() -> None:
    other: Any = Declaring()
    hold(other, "a")
    assert other.declared == []
