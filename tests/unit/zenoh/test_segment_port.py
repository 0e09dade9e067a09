from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh import api
from riot_bus.zenoh import segment_port as module
from riot_bus.zenoh.segment_port import SegmentPort, open_port
from tests.unit.router.fake_bus import Bytes, sample

NAMES = {
    "CongestionControl": ("BLOCK", "DROP"),
    "Reliability": ("RELIABLE", "BEST_EFFORT"),
    "Locality": ("REMOTE",),
    "QueryTarget": ("ALL_COMPLETE", "BEST_MATCHING"),
    "ConsolidationMode": ("NONE",),
}


class Callback:
    def __init__(self, call: Any, drop: Any = None, *, indirect: bool) -> None:
        assert not indirect  # else each has a thread
        self.call, self.drop = call, drop


class Token:
    def cancel(self) -> None:
        self.cancelled = True


class Session:
    """A session that keeps what is declared on it and asked."""

    def __init__(self) -> None:
        self.info = SimpleNamespace(zid=lambda: "abc")
        self.open: list[Any] = []
        self.listening = True
        self.options: dict[str, Any] = {}
        self.watched: list[str] = []

    def declare(self, name: Any) -> Any:
        self.open.append(name)
        return SimpleNamespace(undeclare=lambda: self.open.remove(name))

    def declare_keyexpr(self, text: str) -> str:
        return text

    def declare_publisher(self, key: str, **options: Any) -> Any:
        self.options = options
        made = self.declare(f"publisher {key}")
        made.put = lambda payload, attachment: self.open.append((payload, attachment))
        made.matching_status = SimpleNamespace(matching=True)
        made.declare_matching_listener = lambda handler: self.declare(handler)
        return made

    def declare_subscriber(self, key: str, handler: Callback, **options: Any) -> Any:
        self.options, self.handler = options, handler
        return self.declare(f"subscriber {key}")

    def get(self, key: str, handler: Callback, **options: Any) -> None:
        self.options, self.handler = options, handler

    def close(self) -> None:
        self.open.clear()


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> Any:
    for name, members in NAMES.items():
        monkeypatch.setattr(api, name, SimpleNamespace(**{each: each for each in members}))
    monkeypatch.setattr(api, "handlers", SimpleNamespace(Callback=Callback))
    monkeypatch.setattr(api, "CancellationToken", Token)
    monkeypatch.setattr(api, "Encoding", lambda text: f"<{text}>")
    return Session()


def test_a_publisher_waits_for_slow_receivers_only_if_it_is_reliable(session: Any) -> None:
    with SegmentPort(session, "tcp/x:1") as port:
        port.publisher("a", reliable=True, encoding="text/plain")
        wanted = {"congestion_control": "BLOCK", "reliability": "RELIABLE", "allowed_destination": "REMOTE"}
        assert session.options == wanted | {"encoding": "<text/plain>"}
        outlet = port.publisher("a", reliable=False)
        assert session.options == wanted | {"congestion_control": "DROP", "reliability": "BEST_EFFORT"}
        outlet.put(b"x", b"+")
        assert (session.open.pop(), outlet.matched()) == ((b"x", b"+"), True)


def test_all_that_belongs_to_a_publisher_ends_with_it(session: Any) -> None:
    with SegmentPort(session, "tcp/x:1") as port:
        told: list[int] = []
        outlet = port.publisher("a", reliable=True, changed=lambda: told.append(1))
        listener = session.open[-1]
        listener.call("status")
        outlet.close()
        assert (told, session.open) == ([1], [])


def test_a_subscriber_gets_bytes_but_no_deletes(session: Any) -> None:
    with SegmentPort(session, "tcp/x:1") as port:
        got: list[Any] = []
        inlet = port.subscribe("a/**", lambda payload, attachment: got.append((payload, attachment)))
        for each in (sample(b"0"), sample(b"", kind=1), sample(b"1", attachment=b"+")):
            session.handler.call(each)
        assert got == [(b"0", None), (b"1", b"+")]
        assert session.options == {"allowed_origin": "REMOTE"}
        inlet.close()
        assert session.open == []


def reply(payload: bytes | None) -> Any:
    return SimpleNamespace(ok=None if payload is None else SimpleNamespace(payload=Bytes(payload)))


@pytest.mark.parametrize(
    ("replies", "answer"), [([b"one", b"two"], b"one"), ([None, b"two"], b"two"), ([None], None), ([], None)]
)
def test_a_question_has_one_answer_or_none(session: Any, replies: list[bytes | None], answer: bytes | None) -> None:
    with SegmentPort(session, "tcp/x:1") as port:
        answers: list[bytes | None] = []
        port.ask("a", b"what", b"who", answers.append, complete=not replies)
        assert session.options["target"] == ("BEST_MATCHING" if replies else "ALL_COMPLETE")
        for each in replies:
            session.handler.call(reply(each))
        session.handler.drop()
        assert answers == [answer]


def test_a_question_that_is_given_up_has_no_answer(session: Any) -> None:
    with SegmentPort(session, "tcp/x:1") as port:
        answers: list[bytes | None] = []
        asked = port.ask("a", b"what", b"who", answers.append)
        asked.close()
        asked.close()
        session.handler.call(reply(b"late"))
        session.handler.drop()
        assert (answers, asked.token.cancelled) == ([], True)


def test_tokens_of_one_expression_are_subscribed_to_once(session: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    class Table:
        def __init__(self, session: Any, expression: str) -> None:
            session.watched.append(expression)

        def follow(self, take: Any) -> None:
            take(session.watched[-1], True)

    monkeypatch.setattr(module, "TokenTable", Table)
    heard: list[str] = []
    with SegmentPort(session, "tcp/x:1") as port:
        for expression in ("a/**", "a/**", "b/**"):
            port.watch(expression, lambda token, there: heard.append(token))
    assert (session.watched, heard) == (["a/**", "b/**"], ["a/**", "a/**", "b/**"])


def test_the_first_endpoint_that_answers_is_used_and_shown_without_secrets(
    session: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[Any] = []

    def open_session(config: dict[str, Any], *, purpose: str) -> Any:
        tried.append((config["connect/endpoints"], config["timestamping/enabled"], config.get("x")))
        if len(tried) < 2:
            raise EnvironmentFaultError("nobody answers")
        return session

    monkeypatch.setattr(module, "open_session", open_session)
    port = open_port(SegmentPort, ["tcp/a:1", "tcp/b:2#secret=1", "tcp/c:3"], config={"x": 1})
    assert tried == [(["tcp/a:1"], True, 1), (["tcp/b:2#secret=1"], True, 1)]
    assert port.endpoint.startswith("tcp/b:2")
    assert "secret=1" not in port.endpoint
    port.__exit__()


def test_if_nobody_answers_the_first_reason_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(config: dict[str, Any], *, purpose: str) -> None:
        raise EnvironmentFaultError(f"nobody at {config['connect/endpoints'][0]}")

    monkeypatch.setattr(module, "open_session", refuse)
    with pytest.raises(EnvironmentFaultError, match="nobody at tcp/a:1"):
        open_port(SegmentPort, ["tcp/a:1", "tcp/b:2"])
    with pytest.raises(EnvironmentFaultError, match="no endpoint"):
        open_port(SegmentPort, [])
