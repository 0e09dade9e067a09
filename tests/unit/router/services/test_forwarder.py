from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.router.services.forwarder import CallForwarder, Limits
from riot_bus.zenoh import libraries
from tests.unit.router.fake_bus import LIBRARY, WAIT_S, Bytes, FakeBus, sample

Act = Callable[[Any], object]


class Token:
    cancelled = 0

    def cancel(self) -> None:
        self.cancelled += 1


class Callback:
    def __init__(self, call: Any, drop: Any = None, *, indirect: bool) -> None:
        self.call, self.drop = call, drop


class Session:
    """A segment with a service that answers with these samples, at once or when it is told to."""

    def __init__(self, *answers: Any, at_once: bool = True) -> None:
        self.answers, self.at_once = answers, at_once
        self.asked: list[Any] = []
        self.tokens: list[Token] = []
        self.came = threading.Event()

    def get(self, selector: Any, handler: Callback, **options: Any) -> None:
        payload = options["payload"]
        self.asked.append((selector, payload, options["attachment"], options["target"]))
        self.tokens.append(options["cancellation_token"])
        if self.at_once:
            self.answer(handler)
        self.came.set()

    def answer(self, handler: Callback) -> None:
        for each in self.answers:
            ok = each if each.kind is not None else None
            handler.call(SimpleNamespace(ok=ok, result=each))
        handler.drop()


class Query:
    """A call of a component."""

    def __init__(self, payload: bytes | None = b"what", key: str = "cut/add") -> None:
        self.key_expr, self.parameters, self.encoding = key, "a=1", None
        self.payload = None if payload is None else Bytes(payload)
        self.attachment = Bytes(b"who")
        self.replies: list[Any] = []
        self.ended = threading.Event()

    def accepts_replies(self) -> str:
        return "matching"

    def reply(self, key: str, payload: bytes, **more: Any) -> None:
        assert not self.ended.is_set()
        self.replies.append((key, payload))

    def reply_err(self, payload: bytes, **more: Any) -> None:
        self.replies.append(("error", payload))

    def reply_del(self, key: str, **more: Any) -> None:
        self.replies.append((key, "delete"))

    def drop(self) -> None:
        assert not self.ended.is_set()
        self.ended.set()


def failed(payload: bytes) -> Any:
    """Return an error reply."""
    return SimpleNamespace(payload=Bytes(payload), encoding="", kind=None)


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., tuple[FakeBus, CallForwarder]]]:
    """A function that takes a query from the segment `system` to the service of the segment `unit`."""
    library = SimpleNamespace(
        **vars(LIBRARY)
        | {
            "handlers": SimpleNamespace(Callback=Callback),
            "Selector": lambda key, parameters: f"{key}?{parameters}",
            "Encoding": str,
            "CancellationToken": Token,
            "QueryTarget": SimpleNamespace(ALL_COMPLETE="complete", BEST_MATCHING="nearest"),
            "ConsolidationMode": SimpleNamespace(NONE="none"),
            "ReplyKeyExpr": SimpleNamespace(ANY="any", MATCHING_QUERY="matching"),
        }
    )
    for kind in (Session, Query):
        monkeypatch.setitem(libraries._by_type, kind, library)
    opened: list[Any] = []

    def begin(service: Session | None, *queries: Query, actions: list[Act] = []) -> tuple[FakeBus, CallForwarder]:  # noqa: B006
        bus = FakeBus(*actions)
        bus.access.sessions["unit"] = service  # type: ignore[assignment]
        made = CallForwarder(
            "system",
            "cut/**",
            deliveries=bus.deliveries,
            owner=lambda key: "cut/**" if key.startswith("cut/") else "other",
            asked=lambda segment, key: {} if service is None else {"unit": True},
        )
        opened.extend((made, bus))
        for each in queries:
            made.take(each)
        return bus, made

    yield begin
    for each in opened:
        each.close()


def on(part: str, action: Act) -> Act:
    return lambda event: action(event) if event.key.endswith(part) else None


def test_a_call_goes_to_the_service_and_its_replies_come_back_before_its_end(call: Any) -> None:
    query = Query()
    service = Session(sample(b"1", "cut/add"), failed(b"2"), sample(b"", "cut/add", kind=1))
    bus, _ = call(service, query)
    assert query.ended.wait(WAIT_S)
    assert service.asked == [("cut/add?a=1", b"what", b"who", "complete")]
    assert query.replies == [("cut/add", b"1"), ("error", b"2"), ("cut/add", "delete")]
    assert bus.deliveries.losses() == {}


def test_a_call_without_a_payload_stays_so(call: Any) -> None:
    query, service = Query(None), Session()
    call(service, query)
    assert query.ended.wait(WAIT_S)
    assert service.asked[0][1] is None


def test_calls_that_nobody_here_serves_end_at_once(call: Any) -> None:
    alone, other = Query(), Query(key="other/add")
    call(None, alone)
    service = Session()
    call(service, other)
    assert alone.ended.wait(WAIT_S)
    assert other.ended.is_set()
    assert service.asked == alone.replies == []


def test_requests_and_replies_can_be_changed(call: Any) -> None:
    query, service = Query(), Session(sample(b"1", "cut/add"))
    actions = [
        on("@request", lambda event: event.replace(event.payload + b"!")),
        on("@reply", lambda event: event.replace(b"new")),
    ]
    call(service, query, actions=actions)
    assert query.ended.wait(WAIT_S)
    assert service.asked == [("cut/add?a=1", b"what!", b"who", "complete")]
    assert query.replies == [("cut/add", b"new")]


@pytest.mark.parametrize(("part", "asked"), [("@request", 0), ("@reply", 1)])
def test_a_dropped_message_is_as_if_it_were_lost(call: Any, part: str, asked: int) -> None:
    query, service = Query(), Session(sample(b"1", "cut/add"))
    _, forwarder = call(service, query, Query(key="other/x"), actions=[on(part, lambda event: event.drop())])
    done = threading.Event()
    forwarder._worker.later(0, done.set)
    assert done.wait(WAIT_S)
    assert (len(service.asked), query.replies) == (asked, [])
    assert not query.ended.is_set()  # its caller waits for what will never come
    forwarder.close()
    assert query.ended.is_set()


def test_what_is_held_at_the_end_is_lost(call: Any) -> None:
    service, taken = Session(), threading.Event()

    def hold(event: Any) -> None:
        event.delay(3600)
        taken.set()

    query = Query()
    bus, forwarder = call(service, query, actions=[on("@request", hold)])
    assert taken.wait(WAIT_S)
    forwarder.close()
    assert (service.asked, query.ended.is_set(), forwarder.held()) == ([], True, {})
    assert bus.deliveries.losses() == {"held at the end": {"/cut/add/@request": 1}}


def test_of_too_many_open_calls_the_oldest_is_given_up(call: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Limits, "calls", 2)
    queries, service = [Query() for _ in range(3)], Session(at_once=False)
    _, forwarder = call(service, *queries)
    assert queries[0].ended.wait(WAIT_S)
    forwarder._worker.close()
    assert [each.ended.is_set() for each in queries] == [True, False, False]
    assert [token.cancelled for token in service.tokens] == [1, 0, 0]


def test_calls_for_which_there_is_no_room_end_and_are_counted(call: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Limits, "queued", 0)
    query = Query()
    _, forwarder = call(Session(), query)
    assert query.ended.is_set()
    assert forwarder.shed == {"cut/add/@request": 1}


def test_a_session_that_is_closed_loses_the_message_but_ends_the_call(
    call: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise LIBRARY.ZError("closed")

    monkeypatch.setattr(Session, "get", refuse)
    query = Query()
    bus, _ = call(Session(), query)
    assert query.ended.wait(WAIT_S)
    assert bus.deliveries.losses() == {"not published": {"/cut/add/@request": 1}}


def test_who_retires_ends_with_the_last_call(call: Any) -> None:
    query, service = Query(), Session(sample(b"1", "cut/add"), at_once=False)
    handlers: list[Callback] = []
    service.answer = handlers.append  # type: ignore[method-assign, assignment]
    service.at_once = True
    _, forwarder = call(service, query)
    assert service.came.wait(WAIT_S)
    forwarder.retire()
    Session.answer(service, handlers[0])
    assert query.ended.wait(WAIT_S)
    forwarder._worker._thread.join(WAIT_S)
    assert not forwarder._worker._thread.is_alive()
    assert query.replies == [("cut/add", b"1")]
