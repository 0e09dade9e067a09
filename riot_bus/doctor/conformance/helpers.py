"""Helpers that several scenarios share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.doctor.conformance.samples import END, Inbox, show

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.doctor.conformance.end import ScenarioEnd
    from riot_bus.doctor.conformance.scenario import Observation

__all__ = [
    "advanced_publisher",
    "advanced_subscriber",
    "answer",
    "cached",
    "everything",
    "finish",
    "keys_of",
    "put",
    "sequence",
]

_HEARTBEAT_S = 0.05  # shows a loss at once, compared with the 2 s that scenarios wait for it


def everything(end: ScenarioEnd) -> Observation:
    """Subscribe to all keys of the scenario and return what comes before the closing message."""
    inbox = end.subscribe("**")
    end.meet()
    return inbox.shown()


def put(end: ScenarioEnd, rest: str, payload: bytes | str, **options: Any) -> None:
    """Publish a message that must not be dropped."""
    from riot_bus.zenoh import api as zenoh

    end.session.put(end.key(rest), payload, congestion_control=zenoh.CongestionControl.BLOCK, **options)


def finish(end: ScenarioEnd) -> None:
    """Publish the closing message."""
    put(end, "end", END)


def keys_of(samples: list[Any]) -> list[list[str]]:
    """Return the key and the text of each sample."""
    return [[str(sample.key_expr), sample.payload.to_string()] for sample in samples]


def answer(
    end: ScenarioEnd, rest: str, reply: Callable[[Any], None], *, session: Any = None, complete: bool = False
) -> Any:
    """Declare a queryable that ends each query after `reply`."""

    def take(query: Any) -> None:
        with query:
            reply(query)

    return (session or end.session).declare_queryable(end.key(rest), take, complete=complete)


def advanced_publisher(end: ScenarioEnd, rest: str, *, session: Any = None, cache: int | None = 10) -> Any:
    """Declare an advanced publisher with heartbeats."""
    from riot_bus.zenoh import api as zenoh
    from riot_bus.zenoh.api import ext

    return ext.declare_advanced_publisher(
        session or end.session,
        end.key(rest),
        congestion_control=zenoh.CongestionControl.BLOCK,
        cache=None if cache is None else ext.CacheConfig(cache),
        sample_miss_detection=ext.MissDetectionConfig(heartbeat=_HEARTBEAT_S, sporadic_heartbeat=None),
        publisher_detection=True,
    )


def advanced_subscriber(end: ScenarioEnd, rest: str, *, history: int | None = None, recovery: bool = False) -> Inbox:
    """Declare an advanced subscriber."""
    from riot_bus.zenoh.api import ext

    inbox = Inbox()
    inbox.handle = ext.declare_advanced_subscriber(
        end.session,
        end.key(rest),
        inbox,
        history=None if history is None else ext.HistoryConfig(detect_late_publishers=True, max_samples=history),
        recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True) if recovery else None,
        subscriber_detection=True,
    )
    return inbox


def cached(end: ScenarioEnd, rest: str) -> list[str]:
    """Return the texts in an advanced publisher's cache, as late joiners would get them now."""
    replies = end.session.get(f"{end.key(rest)}/@adv/**", timeout=1.0)
    return [reply.ok.payload.to_string() for reply in replies if reply.ok]


def sequence(samples: list[Any]) -> list[Any]:
    """Return the visible parts of an advanced publisher's samples, with sequence numbers relative to the first."""
    shown = []
    first = None
    for sample in samples:
        number = sample.source_info.source_sn if sample.source_info else None
        first = number if first is None else first
        shown.append({**show(sample), "number": None if number is None or first is None else number - first})
    return shown
