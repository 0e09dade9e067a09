"""Which keys reach which subscribers, and how often."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.doctor.conformance.helpers import (
    keys_of,
)
from riot_bus.doctor.conformance.samples import END, Inbox
from riot_bus.doctor.conformance.scenario import Observation, scenario

if TYPE_CHECKING:
    from riot_bus.doctor.conformance.end import ScenarioEnd


def _put_all(end: ScenarioEnd, keys: list[str], closing: list[str]) -> None:
    from riot_bus.zenoh import api as zenoh

    block = zenoh.CongestionControl.BLOCK
    for number, key in enumerate(keys):
        end.session.put(end.key(key), str(number), congestion_control=block)
    for key in closing:
        end.session.put(end.key(key), END, congestion_control=block)


def _all_keys(inboxes: dict[str, Inbox]) -> dict[str, list[list[str]]]:
    """Return what each inbox received, after waiting for each one, since each has its own thread."""
    return {expression: keys_of(inbox.until_end()) for expression, inbox in inboxes.items()}


@scenario("wildcard_subscribers")
class _WildcardSubscribers:
    """Overlapping wildcard subscribers of one session: each gets what it matches, once."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        end.meet()
        _put_all(end, ["a", "a/x", "a/x/y", "ab/x", "b/x/y/z", "@v/x", "a/@v/x"], ["a/x", "a"])

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        expressions = ["**", "*/x", "a/**", "a$*/x", "*", "a", "**/x/**"]
        inboxes = {expression: end.subscribe(expression) for expression in expressions}
        end.meet()
        return _all_keys(inboxes)


@scenario("wildcard_publications")
class _WildcardPublications:
    """Publications on key expressions with wildcards, which reach all that they intersect."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        end.meet()
        _put_all(end, ["*/x", "a/**", "**", "a/x"], ["a/x", "b/x"])

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inboxes = {expression: end.subscribe(expression) for expression in ("a/x", "b/x", "a/*")}
        end.meet()
        return _all_keys(inboxes)


@scenario("verbatim_keys")
class _VerbatimKeys:
    """Keys with verbatim chunks, which only a verbatim subscriber gets."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        end.meet()
        _put_all(end, ["@v/x", "a/@v/x", "a/x"], ["@v/x", "a/@v/x", "a/x"])

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inboxes = {expression: end.subscribe(expression) for expression in ("@v/**", "a/@v/*", "**")}
        end.meet()
        return _all_keys(inboxes)


@scenario("declared_keys")
class _DeclaredKeys:
    """Key expressions that both ends declare beforehand."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        key = end.session.declare_keyexpr(end.key("long/key/expression"))
        publisher = end.session.declare_publisher(key)
        end.meet()
        end.matched(publisher)
        end.session.put(key, "1")
        publisher.put("2")
        end.session.undeclare(key)
        _put_all(end, ["long/key/expression", "other"], ["long/end"])

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        declared = end.session.declare_keyexpr(end.key("long/**"))
        end.session.declare_keyexpr(end.key("never/used"))
        named = Inbox()
        named.handle = end.session.declare_subscriber(declared, named)
        inboxes = {"declared": named, "**": end.subscribe("**")}
        end.meet()
        return _all_keys(inboxes)
