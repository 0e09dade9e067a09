"""What a session tells of a segment; Zenoh's session is a fake that hands out its listeners."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.graph import sources
from riot_bus.graph.sources import AdminView, SegmentSource, admin_views
from riot_bus.types.registry import TypeRegistry

ROUTER = {
    "zid": "aa",
    "metadata": {"name": "base"},
    "locators": ["tcp/127.0.0.1:7447"],
    "sessions": [
        {"peer": "bb", "whatami": "client", "links": [{"src": "tcp/near:1", "dst": "tcp/far:2"}]},
        {"peer": "cc", "whatami": "peer"},
    ],
}
APPEARED, VANISHED = 0, 1


class Session:
    """A session whose events a test makes."""

    def __init__(self) -> None:
        self.info = self
        self.closed: list[str] = []
        self.listeners: dict[str, Any] = {}
        self.receivers: set[str] = set()
        self.declared: list[str] = []
        self.replies: list[Any] = []

    def zid(self) -> str:
        return "ours"

    def liveliness(self) -> Session:
        return self

    def declare_transport_events_listener(self, take: Any, *, history: bool) -> Any:
        return self._listener("transport", take, history)

    def declare_link_events_listener(self, take: Any, *, history: bool) -> Any:
        return self._listener("link", take, history)

    def declare_subscriber(self, expression: str, take: Any, *, history: bool) -> Any:
        return self._listener(expression, take, history)

    def _listener(self, name: str, take: Any, history: bool) -> Any:
        assert history
        assert name not in self.listeners
        self.listeners[name] = take
        return SimpleNamespace(undeclare=lambda: self.closed.append(name))

    def declare_publisher(self, key: str, **_: Any) -> Any:
        session = self
        self.declared.append(key)

        class Publisher:
            @property
            def matching_status(self) -> Any:
                return SimpleNamespace(matching=key in session.receivers)

            def undeclare(self) -> None:
                session.closed.append(key)

        return Publisher()

    def get(self, selector: str, **_: Any) -> list[Any]:
        assert selector == "@/*/*"  # any other could hang a router
        return self.replies

    def transport(self, kind: int, zid: str, mode: str = "") -> None:
        self.listeners["transport"](SimpleNamespace(kind=kind, transport=SimpleNamespace(zid=zid, whatami=mode)))

    def link(self, kind: int, zid: str, end: str) -> None:
        self.listeners["link"](SimpleNamespace(kind=kind, link=SimpleNamespace(zid=zid, dst=end)))

    def token(self, kind: int, key: str) -> None:
        self.listeners["**/@adv/**"](SimpleNamespace(kind=kind, key_expr=key))


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> Session:
    library = SimpleNamespace(
        Locality=SimpleNamespace(REMOTE=1),
        QueryTarget=SimpleNamespace(ALL=1),
        ConsolidationMode=SimpleNamespace(NONE=1),
    )
    monkeypatch.setattr(sources, "library_of", lambda _: library)
    return Session()


def source_of(session: Any) -> tuple[SegmentSource, list[None]]:
    changes: list[None] = []
    source = SegmentSource(session, TypeRegistry(), lambda: changes.append(None))
    source.start()
    return source, changes


def reply(key: str, payload: bytes) -> Any:
    return SimpleNamespace(ok=SimpleNamespace(key_expr=key, payload=SimpleNamespace(to_bytes=lambda: payload)))


def test_an_admin_space_tells_sessions_and_both_ends_of_links() -> None:
    view = AdminView.parse("@/aa/router", json.dumps(ROUTER).encode())
    assert view == AdminView(
        zid="aa",
        mode="router",
        name="base",
        locators=("tcp/127.0.0.1:7447",),
        sessions={"bb": "client", "cc": "peer"},
        links={("tcp/far:2", "tcp/near:1"): "bb"},
    )
    bare = AdminView.parse("@/aa/peer", b'{"zid": "aa", "metadata": {"name": 7}}')
    assert bare == AdminView("aa", "peer")


@pytest.mark.parametrize(
    ("key", "payload"),
    [
        ("@/aa/router", b"\xff"),
        ("@/aa/router", b"[]"),
        ("@/aa/router", b"{}"),
        ("@/bb/router", json.dumps(ROUTER).encode()),
        ("@/aa/router/metrics", json.dumps(ROUTER).encode()),
        ("@/aa/router", b'{"zid": "aa", "sessions": [{"peer": "bb"}]}'),
        ("@/aa/router", b'{"zid": "aa", "sessions": 3}'),
        ("@/aa/router", b'{"zid": "aa", "sessions": [7]}'),
    ],
)
def test_any_other_reply_is_left_out(key: str, payload: bytes) -> None:
    assert AdminView.parse(key, payload) is None


def test_views_are_those_of_all_that_reply(session: Any) -> None:
    session.replies = [
        reply("@/aa/router", json.dumps(ROUTER).encode()),
        SimpleNamespace(ok=None),
        reply("@/dd/peer", b"nonsense"),
        reply("@/ee/peer", b'{"zid": "ee"}'),
    ]
    assert {zid: view.mode for zid, view in admin_views(session).items()} == {"aa": "router", "ee": "peer"}


def test_sessions_and_links_come_and_go(session: Any) -> None:
    source, changes = source_of(session)
    session.transport(APPEARED, "aa", "client")
    for end in ("tcp/b:2", "tcp/a:1"):
        session.link(APPEARED, "aa", end)
    session.link(APPEARED, "bb", "tcp/c:3")  # a link may come before its session
    assert source.modes() == {"aa": "client"}
    assert source.addresses() == {"aa": ["tcp/a:1", "tcp/b:2"], "bb": ["tcp/c:3"]}
    session.link(VANISHED, "bb", "tcp/c:3")
    assert source.addresses() == {"aa": ["tcp/a:1", "tcp/b:2"]}
    session.transport(VANISHED, "aa")
    session.link(VANISHED, "aa", "tcp/a:1")  # and go after it
    session.transport(VANISHED, "unknown")
    assert (source.modes(), source.addresses()) == ({}, {})
    assert len(changes) == 8


def test_tokens_come_and_go_and_unknown_ones_are_no_change(session: Any) -> None:
    source, changes = source_of(session)
    for key in ("k/@adv/pub/aa/1/_", "k/@adv/sub/bb/1/_", "k/@adv/strange"):
        session.token(APPEARED, key)
    assert {(each.zid, each.role) for each in source.tokens()} == {("aa", "publishes"), ("bb", "subscribes")}
    session.token(VANISHED, "k/@adv/pub/aa/1/_")
    assert [each.zid for each in source.tokens()] == ["bb"]
    assert len(changes) == 3


def test_a_key_is_watched_once_until_the_source_stops(session: Any) -> None:
    source, _ = source_of(session)
    source.watch_matching(["j", "k"])
    source.watch_matching(["k"])
    assert source.matching() == set()
    session.receivers.add("k")
    assert source.matching() == {"k"}
    assert session.declared == ["j", "k"]
    source.stop()
    source.stop()
    assert sorted(session.closed) == ["**/@adv/**", "j", "k", "link", "transport"]
    assert source.matching() == set()
