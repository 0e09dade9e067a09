from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.zenoh import libraries
from riot_bus.zenoh.attachment_probe import AttachmentProbe
from tests.unit.router.fake_bus import sample


class ClosedError(Exception):
    pass


class Session:
    """A session with a subscription, and caches with some attachments."""

    def __init__(self, *cached: bytes | None, closed: bool = False) -> None:
        self.cached, self.closed = cached, closed
        self.subscribed: list[str] = []

    def declare_subscriber(self, key: str, take: Any) -> Any:
        if self.closed:
            raise ClosedError
        self.subscribed.append(key)
        self.take = take
        return SimpleNamespace(undeclare=lambda: self.subscribed.remove(key))

    def get(self, selector: str, take: Any, **options: Any) -> None:
        assert selector == "cut/a/@adv/pub/**"
        take(SimpleNamespace(ok=None))
        for each in self.cached:
            take(SimpleNamespace(ok=sample(attachment=each)))


@pytest.fixture(autouse=True)
def without_zenoh(monkeypatch: pytest.MonkeyPatch) -> None:
    library = SimpleNamespace(
        ZError=ClosedError,
        handlers=SimpleNamespace(Callback=lambda call, indirect: call),
        ConsolidationMode=SimpleNamespace(NONE="none"),
        ReplyKeyExpr=SimpleNamespace(ANY="any"),
        Locality=SimpleNamespace(REMOTE="remote"),
    )
    monkeypatch.setitem(libraries._by_type, Session, library)


def probe(*sessions: Any) -> tuple[AttachmentProbe, list[int]]:
    heard: list[int] = []
    return AttachmentProbe("cut/a", sessions, lambda: heard.append(1)), heard


def test_attachments_are_those_of_messages_that_come_and_that_were_kept() -> None:
    session: Any = Session(b"kept", None)
    found, heard = probe(Session(closed=True), session)
    assert (found.attachments, len(heard)) == ([b"kept"], 1)
    session.take(sample(attachment=b"new"))
    session.take(sample())
    assert (found.attachments, len(heard)) == ([b"kept", b"new"], 2)


def test_long_ones_and_too_many_are_left_out() -> None:
    session: Any = Session(b"x" * 10_000)
    found, heard = probe(session)
    assert found.attachments == []
    for number in range(100):
        session.take(sample(attachment=bytes([number])))
    assert len(found.attachments) == len(heard) < 50


def test_the_subscriptions_end_once() -> None:
    session: Any = Session()
    found, _ = probe(session)
    assert session.subscribed == ["cut/a"]
    found.close()
    found.close()
    assert session.subscribed == []
