from __future__ import annotations

from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.router.advanced import publisher_proxies as module
from riot_bus.router.advanced.publisher_proxies import PublisherProxies
from riot_bus.router.advanced.publisher_state import Relayed
from riot_bus.router.advanced.source import AdvancedSource
from riot_bus.zenoh import libraries
from tests.unit.router.fake_bus import LIBRARY, FakeBus, sample

WATCHED = "cut/**/@adv/pub/**"
FIRST = AdvancedSource("system", "cut/a", "abc", "1")


class Hand:
    """A worker whose jobs are done when the test says so."""

    def __init__(self, name: str) -> None:
        self.jobs: deque[Callable[[], None]] = deque()
        self.timed: list[Callable[[], None]] = []

    def do(self, job: Callable[[], None]) -> None:
        self.jobs.append(job)

    def later(self, seconds: float, job: Callable[[], None], *, background: bool) -> None:
        self.timed.append(job)

    def tick(self) -> None:
        timed, self.timed = self.timed, []
        for job in (*self.jobs, *timed):
            job()
        self.jobs.clear()

    def idle(self) -> bool:
        return not self.jobs

    def close(self) -> None:
        self.tick()


class Mirror:
    """Notes what is to be done for publishers; they end at once."""

    def __init__(self, deliveries: Any, **others: Any) -> None:
        self.steps: list[Any] = []

    def open(self, state: Any) -> None:
        self.steps.append(("open", state.source))

    def end(self, state: Any, gone: Callable[[], None]) -> None:
        self.steps.append(("end", state.source))
        gone()

    def recover(self, state: Any, first: int, last: int) -> None:
        self.steps.append(("recover", first, last))

    def check(self, state: Any) -> None:
        self.steps.append(("check", state.source))


class Upstream:
    """Caches that are found when the test says so."""

    def __init__(self, sessions: Any, worker: Any) -> None:
        self.found: list[Callable[[AdvancedSource], None]] = []
        self.asked: list[tuple[str, str]] = []

    def search(self, segment: str, selector: str, found: Callable[[AdvancedSource], None]) -> None:
        self.asked.append((segment, selector))
        self.found.append(found)


class Answers:
    def __init__(self, sessions: Any, worker: Any, find: Any) -> None:
        self.keys: set[str] = set()
        self.find = find

    def begin(self, key: str) -> None:
        self.keys.add(key)

    def end(self, key: str) -> None:
        self.keys.discard(key)


class Session:
    """A segment's session with tokens, to which components are connected."""

    def __init__(self, zid: str) -> None:
        self.near: list[str] = []
        self.info = SimpleNamespace(
            zid=lambda: zid, transports=lambda: [SimpleNamespace(zid=each) for each in self.near]
        )
        self.tokens: dict[str, Any] = {}

    def liveliness(self) -> Any:
        return SimpleNamespace(declare_subscriber=self.watch, get=lambda text, timeout: [])

    def watch(self, text: str, seen: Any, *, history: bool) -> Any:
        self.tokens[text] = seen
        return SimpleNamespace(undeclare=lambda: self.tokens.pop(text))

    def declare_subscriber(self, text: str, heard: Any, *, allowed_origin: str) -> Any:
        return SimpleNamespace(undeclare=lambda: None)

    def say(self, source: AdvancedSource, *, gone: bool = False) -> None:
        token = f"{source.key}/@adv/pub/{source.zid}/{source.entity}/_"
        self.tokens[WATCHED](SimpleNamespace(key_expr=token, kind=int(gone)))


class Bench:
    """Proxies for the publishers of `cut/**` in two segments."""

    def __init__(self) -> None:
        self.bus = FakeBus()
        self.sessions = {"system": Session("s"), "unit": Session("u")}
        self.bus.access.sessions.update(self.sessions)  # type: ignore[arg-type]
        self.changes = 0
        self.proxies = PublisherProxies(self.bus.deliveries, changed=self._changed, fence=lambda name: lambda: True)
        self.worker: Any = self.proxies._worker
        self.mirror: Any = self.proxies._mirror
        self.upstream: Any = self.proxies._upstream
        self.answers: Any = self.proxies._answers
        self.proxies.watch("cut/**", again=False)

    def _changed(self) -> None:
        self.changes += 1

    def numbered(self, number: int, source: AdvancedSource = FIRST) -> Any:
        found = sample(str(number).encode(), source.key)
        origin = SimpleNamespace(zid=source.zid, eid=source.entity)
        found.source_info = SimpleNamespace(source_id=origin, source_sn=number)
        return found


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Any:
    for name, fake in {"Worker": Hand, "HistoryMirror": Mirror, "Upstream": Upstream, "Answers": Answers}.items():
        monkeypatch.setattr(module, name, fake)
    monkeypatch.setitem(libraries._by_type, Session, LIBRARY)
    made = Bench()
    yield made
    made.bus.close()


def test_a_publisher_is_known_from_its_token_until_that_is_gone(bench: Bench) -> None:
    bench.sessions["system"].say(FIRST)
    bench.sessions["system"].say(FIRST)
    bench.worker.tick()
    assert list(bench.proxies.keys["cut/a"]) == [FIRST]
    assert (bench.mirror.steps, bench.answers.keys, bench.changes) == ([("open", FIRST)], {"cut/a"}, 1)
    assert [state.source for state in bench.answers.find("cut/a", "abc")] == [FIRST]
    bench.sessions["system"].say(FIRST, gone=True)
    assert (bench.proxies.keys, bench.answers.keys) == ({}, set())
    assert bench.mirror.steps[1:] == [("end", FIRST)]


def test_our_own_proxies_and_what_came_natively_are_no_publishers(bench: Bench) -> None:
    bench.sessions["system"].say(FIRST._replace(zid="u"))
    bench.sessions["system"].say(FIRST)
    bench.sessions["unit"].say(FIRST)
    assert {key: list(here) for key, here in bench.proxies.keys.items()} == {"cut/a": [FIRST]}


def test_numbered_samples_tell_their_publisher_and_others_are_asked_for_once(bench: Bench) -> None:
    assert bench.proxies.concerns("system", "cut/a", bench.numbered(1))
    plain = FIRST._replace(key="cut/b")
    asked = len(bench.upstream.asked)
    for _ in range(3):
        assert not bench.proxies.concerns("system", "cut/b", sample(key="cut/b"))
    bench.worker.tick()
    assert bench.upstream.asked[asked:] == [("system", "cut/b/@adv/pub/**?_max=1")]
    bench.upstream.found[-1](plain)
    assert bench.proxies.concerns("system", "cut/b", sample(key="cut/b"))


def test_samples_that_did_not_come_are_fetched(bench: Bench) -> None:
    bench.sessions["system"].say(FIRST)
    (state,) = bench.proxies.keys["cut/a"].values()
    first = bench.proxies.take("system", bench.numbered(5))
    assert isinstance(first, Relayed)
    assert (first.state, state.busy) == (state, True)
    bench.proxies.through(first)
    assert not state.busy
    bench.proxies.take("system", bench.numbered(9))
    assert ("recover", 6, 8) in bench.mirror.steps


def test_messages_belong_to_the_stream_that_they_came_with(bench: Bench) -> None:
    bench.sessions["system"].say(FIRST)
    (state,) = bench.proxies.keys["cut/a"].values()
    relayed = bench.proxies.take("system", bench.numbered(1))
    assert relayed is not None
    plain = bench.bus.access.converters["system"](sample())
    assert bench.proxies.state_of(relayed, relayed) is state
    assert bench.proxies.state_of(relayed, relayed.with_(key="cut/b")) is None
    assert bench.proxies.state_of(plain, plain) is None
    assert bench.proxies.state_of(None, plain) is state  # what was added goes to the only one
    bench.sessions["system"].say(FIRST._replace(entity="2"))
    assert bench.proxies.state_of(None, plain) is None


def test_late_samples_do_not_revive_who_has_ended_but_a_token_does(bench: Bench) -> None:
    bench.sessions["system"].say(FIRST)
    bench.sessions["system"].say(FIRST, gone=True)
    assert not isinstance(bench.proxies.take("system", bench.numbered(9)), Relayed)
    assert bench.proxies.keys == {}
    bench.sessions["system"].say(FIRST)
    assert list(bench.proxies.keys["cut/a"]) == [FIRST]


def test_a_publisher_without_a_token_ends_with_its_session(bench: Bench) -> None:
    bench.proxies.concerns("system", "cut/a", bench.numbered(1))
    bench.worker.tick()
    assert FIRST in bench.proxies.keys["cut/a"]  # it may be far away, where nobody knows its session
    bench.sessions["system"].near = ["abc"]
    bench.worker.tick()
    bench.sessions["system"].near = []
    bench.worker.tick()
    assert bench.proxies.keys == {}


def test_nothing_is_left_of_what_is_not_watched_any_more(bench: Bench) -> None:
    bench.sessions["system"].say(FIRST)
    bench.proxies.unwatch("cut/**")
    assert (bench.proxies.keys, bench.proxies.watched) == ({}, [])
    assert [session.tokens for session in bench.sessions.values()] == [{}, {}]
    bench.proxies.close()
    assert not bench.proxies.concerns("system", "cut/a", bench.numbered(2))


def test_invented_publishers_take_no_memory_without_end(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_RELAYS", 3)
    for number in range(10):
        bench.sessions["system"].say(FIRST._replace(key=f"cut/{number}"))
    assert len(bench.proxies.keys) == 3
