from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.pipeline import mailbox
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh import client as module
from riot_bus.zenoh.client import Client, open_client
from tests.unit.router.fake_bus import sample

WAIT_S = 20.0


class Session:
    """A session to whose subscribers one can send."""

    def __init__(self) -> None:
        self.info = SimpleNamespace(zid=lambda: 0xABC)
        self.takes: dict[str, Any] = {}
        self.puts: list[Any] = []
        self.closed = 0

    def declare_subscriber(self, key: str, take: Any) -> Any:
        self.takes[key] = take
        return SimpleNamespace(undeclare=lambda: self.takes.pop(key))

    def put(self, key: str, payload: bytes, **options: Any) -> None:
        self.puts.append((key, payload, options["attachment"], options["express"]))

    def close(self) -> None:
        self.closed += 1


def test_messages_are_numbered_and_arrive_in_order_before_the_end() -> None:
    session: Any = Session()
    got: list[Message] = []
    with Client(session) as client:
        assert client.zid == str(0xABC)
        subscription = client.subscribe("cut/**/**", got.append)
        for text in (b"0", b"1"):
            session.takes["cut/**"](sample(text))
        subscription.undeclare()
    assert [(each.sequence, each.payload, each.key) for each in got] == [(1, b"0", "cut/a"), (2, b"1", "cut/a")]
    client.close()
    assert session.closed == 2


def test_what_a_slow_callback_leaves_no_room_for_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    session: Any = Session()
    entered, free = threading.Event(), threading.Event()
    small: Any = mailbox.Mailbox(capacity=1)
    dispatcher = mailbox.Dispatcher
    monkeypatch.setattr(module, "Dispatcher", lambda name, lost: dispatcher(name, lost, mailbox=small))

    def slow(message: Message) -> None:
        entered.set()
        assert free.wait(WAIT_S)

    with Client(session) as client:
        client.subscribe("cut/**", slow)
        session.takes["cut/**"](sample())
        assert entered.wait(WAIT_S)
        for _ in range(4):
            session.takes["cut/**"](sample())
        free.set()
    assert client.lost == {"cut/a": 3}


def test_it_publishes_with_the_quality_of_the_message() -> None:
    session: Any = Session()
    with Client(session) as client:
        client.put(Message(0, "a", b"x", attachment=b"+", qos=Qos(express=True)))
    assert session.puts == [("a", b"x", b"+", True)]


def test_what_is_no_key_expression_is_not_subscribed_to() -> None:
    session: Any = Session()
    with Client(session) as client, pytest.raises(ConfigError, match="'a//b' is not a key expression"):
        client.subscribe("a//b", lambda message: None)
    assert session.takes == {}


def test_it_is_a_client_of_one_router(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[dict[str, Any]] = []

    def open_session(config: dict[str, Any], *, purpose: str) -> Session:
        opened.append(config)
        return Session()

    monkeypatch.setattr(module, "open_session", open_session)
    monkeypatch.setattr(module, "prepare_runtime", lambda: None)
    with open_client("tcp/x:1", config={"more": 1}):
        pass
    (config,) = opened
    assert (config["mode"], config["connect/endpoints"], config["more"]) == ("client", ["tcp/x:1"], 1)
