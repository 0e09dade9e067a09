"""Presence of other components: liveliness and matching."""

from __future__ import annotations

import contextlib
from functools import partial
from typing import Any

from riot_bus.zenoh.session import wait_until
from riot_bus_conformance.end import Observation, ScenarioEnd
from riot_bus_conformance.samples import Inbox, show_replies
from riot_bus_conformance.scenario import scenario

_BUS_SUBSCRIBES = "the bus itself subscribes to what it intercepts, so every publisher is matched"


def _events(samples: list[Any]) -> list[list[str]]:
    return [[str(sample.key_expr), "gone" if int(sample.kind) else "here"] for sample in samples]


@scenario("liveliness")
class _Liveliness(ScenarioEnd):
    """Tokens that appear and disappear, as a subscriber and a query see them."""

    def left(self) -> Observation:
        self.meet()
        _, inner = self.token("a"), self.token("b/c")
        self.wait("here")
        inner.undeclare()

    def right(self) -> Observation:
        inbox = self.tokens("**")
        self.meet()
        inbox.take(2)
        both = self._present(2)
        self.signal("here")
        inbox.take(3)
        one = self._present(1)
        events = _events(inbox.wait())
        return [both, one, sorted(events[:2]), events[2:]]

    def _present(self, count: int) -> list[dict[str, Any]]:
        """Query tokens until there are `count`: with more than one router, Zenoh may overlook new ones."""
        replies: list[dict[str, Any]] = []

        def enough() -> bool:
            nonlocal replies
            replies = show_replies(self.session.liveliness().get(self.key("**"), timeout=5.0))
            return len(replies) == count

        wait_until(enough, 5.0)
        return replies


@scenario("liveliness_history")
class _LivelinessHistory(ScenarioEnd):
    """Subscribers that come after the tokens: with history they hear of them, without they do not."""

    def left(self) -> Observation:
        self.token("old/1")
        self.token("old/2")
        self.meet()
        self.wait("subscribed")
        self.token("new")

    def right(self) -> Observation:
        self.meet()
        history, none = self.tokens("**", history=True), self.tokens("**")
        history.take(2)
        self.signal("subscribed")
        return {"history": sorted(history.take(3), key=str), "none": none.take(1)}


@scenario("liveliness_of_killed")
class _LivelinessOfKilled(ScenarioEnd):
    """A token's process is killed: the token is gone."""

    def left(self) -> Observation:
        inbox = self.tokens("**")
        self.meet()
        inbox.take(1)
        self.kill_other(again=False)
        return _events(inbox.received(2))

    def right(self) -> Observation:
        self.meet()
        self.token("me")
        self.wait("never", 60.0)


def _last_is(heard: list[bool], matching: object) -> bool:
    return heard[-1:] == [matching]


@scenario("matching", limits={"intercepted": _BUS_SUBSCRIBES})
class _Matching(ScenarioEnd):
    """A publisher learns that a subscriber elsewhere comes and goes, and comes again."""

    def left(self) -> Observation:
        heard: list[bool] = []
        publisher = self.publisher("x")
        self.keep(publisher.declare_matching_listener(lambda status: heard.append(status.matching)))
        self.meet()
        seen = [publisher.matching_status.matching]
        for matching in (True, False, True):
            self.signal("go on")
            self.wait("did")
            with contextlib.suppress(TimeoutError):  # another status is an observation too
                self.matched(publisher, matching=matching, timeout=2.0)
                self.until(partial(_last_is, heard, matching), "the listener to hear of it", 2.0)
            seen.append(publisher.matching_status.matching)
        return {"seen": seen, "heard": heard}

    def right(self) -> Observation:
        self.meet()
        inboxes: list[Inbox] = []
        for step in range(3):
            self.wait("go on")
            if step == 1:
                inboxes.pop().handle.undeclare()
            else:
                inboxes.append(self.subscribe("x"))
            self.signal("did")
        return len(inboxes)


@scenario("matching_local", limits={"intercepted": _BUS_SUBSCRIBES})
class _MatchingLocal(ScenarioEnd):
    """A publisher whose only subscriber is at its own end."""

    def left(self) -> Observation:
        other = self.open()
        publisher = self.publisher("x")
        self.meet()
        before = publisher.matching_status.matching
        inbox = self.subscribe("x", other)
        self.matched(publisher)
        publisher.put("1")
        return [before, inbox.take(1)]

    def right(self) -> Observation:
        publisher = self.publisher("unheard")
        self.meet()
        return publisher.matching_status.matching


@scenario("nobody_listens")
class _NobodyListens(ScenarioEnd):
    """Publications without a subscriber harm nobody, and a subscriber that left hears nothing."""

    def left(self) -> Observation:
        self.meet()
        self.session.put(self.key("x"), "1")
        self.wait("left")
        self.session.put(self.key("x"), "2")
        self.session.put(self.key("y"), "3")

    def right(self) -> Observation:
        gone, stays = self.subscribe("x"), self.subscribe("y")
        self.meet()
        gone.take(1)
        gone.handle.undeclare()
        self.signal("left")
        return [stays.take(1), gone.take(1)]
