from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.zenoh import api
from riot_bus.zenoh.token_table import TokenTable


class Liveliness:
    """Notifies a subscriber of what exists, then ends the query."""

    def __init__(self, *present: str) -> None:
        self.present = present

    def declare_subscriber(self, expression: str, heard: Any, *, history: bool) -> None:
        assert history
        self.heard = heard
        for token in self.present:
            self.say(token)

    def get(self, expression: str, unread: Any, *, timeout: float) -> None:
        unread.call(None)
        unread.drop()

    def say(self, token: str, *, there: bool = True) -> None:
        self.heard.call(SimpleNamespace(key_expr=token, kind=int(not there)))


@pytest.fixture
def liveliness(monkeypatch: pytest.MonkeyPatch) -> Liveliness:
    def callback(call: Any, drop: Any = None, *, indirect: bool) -> Any:
        return SimpleNamespace(call=call, drop=drop)

    monkeypatch.setattr(api, "handlers", SimpleNamespace(Callback=callback), raising=False)
    return Liveliness("a", "b")


def test_a_follower_hears_what_exists_and_each_change_once(liveliness: Liveliness) -> None:
    session: Any = SimpleNamespace(liveliness=lambda: liveliness)
    table = TokenTable(session, "**")
    first: list[tuple[str, bool]] = []
    second: list[tuple[str, bool]] = []
    following = table.follow(lambda token, there: first.append((token, there)))
    assert first == [("a", True), ("b", True)]
    for there in (False, False, True, True):
        liveliness.say("a", there=there)
    liveliness.say("c")
    assert first[2:] == [("a", False), ("a", True), ("c", True)]
    following.close()
    table.follow(lambda token, there: second.append((token, there)))
    liveliness.say("b", there=False)
    assert len(first) == 5
    assert second == [("b", True), ("a", True), ("c", True), ("b", False)]


def test_a_follower_may_leave_while_it_is_told(liveliness: Liveliness) -> None:
    session: Any = SimpleNamespace(liveliness=lambda: liveliness)
    table, heard = TokenTable(session, "**"), list[str]()

    def take(token: str, there: bool) -> None:
        heard.append(token)
        if token == "c":
            leaver.close()

    leaver = table.follow(take)
    table.follow(lambda token, there: heard.append(f"other {token}"))
    heard.clear()
    liveliness.say("c")
    liveliness.say("d")
    assert heard == ["c", "other c", "other d"]
