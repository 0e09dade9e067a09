"""Presence of other components: liveliness and matching."""

from __future__ import annotations

import contextlib
from functools import partial
from typing import TYPE_CHECKING, Any

from riot_bus.doctor.conformance.samples import Inbox, show_replies
from riot_bus.doctor.conformance.scenario import Observation, scenario
from riot_bus.zenoh.session import wait_until

if TYPE_CHECKING:
    from riot_bus.doctor.conformance.end import ScenarioEnd

_BUS_SUBSCRIBES = "the bus itself subscribes to what it intercepts, so every publisher is matched"


def _events(samples: list[Any]) -> list[list[str]]:
    return [[str(sample.key_expr), "gone" if int(sample.kind) else "here"] for sample in samples]


def _ask(end: ScenarioEnd, rest: str, count: int) -> list[dict[str, Any]]:
    """Query tokens until there are `count`: with more than one router, Zenoh may overlook new ones."""
    replies: list[dict[str, Any]] = []

    def enough() -> bool:
        nonlocal replies
        replies = show_replies(end.session.liveliness().get(end.key(rest), timeout=5.0))
        return len(replies) == count

    wait_until(enough, 5.0)
    return replies


@scenario("liveliness")
class _Liveliness:
    """Tokens that appear and disappear, as a subscriber and a query see them."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        end.meet()
        liveliness = end.session.liveliness()
        tokens = {name: liveliness.declare_token(end.key(name)) for name in ("a", "b/c")}
        end.wait("here")
        tokens["b/c"].undeclare()
        end.wait("gone")
        return None

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inbox = Inbox()
        subscriber = end.session.liveliness().declare_subscriber(end.key("**"), inbox)
        end.meet()
        inbox.take(2)
        both = _ask(end, "**", 2)
        end.signal("here")
        inbox.take(3)
        one = _ask(end, "**", 1)
        events = _events(inbox.wait(bool))
        end.signal("gone")
        return [both, one, sorted(events[:2]), events[2:], subscriber is not None]


@scenario("liveliness_history")
class _LivelinessHistory:
    """Subscribers that come after the tokens: with history they hear of them, without they do not."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        liveliness = end.session.liveliness()
        tokens = [liveliness.declare_token(end.key(name)) for name in ("old/1", "old/2")]
        end.meet()
        end.wait("subscribed")
        tokens.append(liveliness.declare_token(end.key("new")))
        end.wait("done")
        return len(tokens)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        end.meet()
        inboxes = {"history": Inbox(), "none": Inbox()}
        for name, inbox in inboxes.items():
            inbox.handle = end.session.liveliness().declare_subscriber(end.key("**"), inbox, history=name == "history")
        inboxes["history"].take(2)
        end.signal("subscribed")
        seen = {"history": sorted(inboxes["history"].take(3), key=str), "none": inboxes["none"].take(1)}
        end.signal("done")
        return seen


@scenario("liveliness_of_killed")
class _LivelinessOfKilled:
    """A token's process is killed: the token is gone."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        inbox = Inbox()
        subscriber = end.session.liveliness().declare_subscriber(end.key("**"), inbox)
        end.meet()
        inbox.take(1)
        end.kill_other(again=False)
        return [_events(inbox.wait(lambda samples: len(samples) >= 2)), subscriber is not None]

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        end.meet()
        token = end.session.liveliness().declare_token(end.key("me"))
        end.wait("never", 60.0)
        return str(token)


def _last_is(heard: list[bool], matching: object) -> bool:
    return heard[-1:] == [matching]


@scenario("matching", limits={"intercepted": _BUS_SUBSCRIBES})
class _Matching:
    """A publisher learns that a subscriber elsewhere comes and goes, and comes again."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        heard: list[bool] = []
        publisher = end.session.declare_publisher(end.key("x"))
        listener = publisher.declare_matching_listener(lambda status: heard.append(status.matching))
        end.meet()
        seen = [publisher.matching_status.matching]
        for matching in (True, False, True):
            end.signal("go on")
            end.wait("did")
            with contextlib.suppress(TimeoutError):  # another status is an observation too
                end.matched(publisher, matching=matching, timeout=2.0)
                end.until(partial(_last_is, heard, matching), "the listener to hear of it", 2.0)
            seen.append(publisher.matching_status.matching)
        return {"seen": seen, "heard": heard, "listening": listener is not None}

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        end.meet()
        inboxes: list[Inbox] = []
        for step in range(3):
            end.wait("go on")
            if step == 1:
                inboxes.pop().handle.undeclare()
            else:
                inboxes.append(end.subscribe("x"))
            end.signal("did")
        return len(inboxes)


@scenario("matching_local", limits={"intercepted": _BUS_SUBSCRIBES})
class _MatchingLocal:
    """A publisher whose only subscriber is at its own end."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        other = end.open()
        publisher = end.session.declare_publisher(end.key("x"))
        end.meet()
        before = publisher.matching_status.matching
        inbox = end.subscribe("x", other)
        end.matched(publisher)
        publisher.put("1")
        return [before, inbox.take(1)]

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        publisher = end.session.declare_publisher(end.key("unheard"))
        end.meet()
        return publisher.matching_status.matching


@scenario("nobody_listens")
class _NobodyListens:
    """Publications without a subscriber harm nobody, and a subscriber that left hears nothing."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        end.meet()
        end.session.put(end.key("x"), "1")
        end.wait("left")
        end.session.put(end.key("x"), "2")
        end.session.put(end.key("y"), "3")
        end.wait("done")
        return None

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        gone, stays = end.subscribe("x"), end.subscribe("y")
        end.meet()
        gone.take(1)
        gone.handle.undeclare()
        end.signal("left")
        seen = [stays.take(1), gone.take(1)]
        end.signal("done")
        return seen
