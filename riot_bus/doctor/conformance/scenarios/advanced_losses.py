"""Advanced publishers and subscribers whose messages get lost, or that talk to plain ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.doctor.conformance.helpers import (
    advanced_publisher,
    advanced_subscriber,
    sequence,
)
from riot_bus.doctor.conformance.samples import CallCollector
from riot_bus.doctor.conformance.scenario import Observation, scenario

if TYPE_CHECKING:
    from riot_bus.doctor.conformance.end import ScenarioEnd

_STAMPED = {"timestamping/enabled": True}
_LOSSES = [
    {
        "id": "lossy",
        "messages": ["put"],
        "flows": ["egress"],
        "key_exprs": ["riot_transparency/*/lossy"],
        "size_limit": 100,
    }
]
"""The publisher's own session drops large messages, so that a receiver has something to recover."""

_LARGE = "x" * 200


@scenario("advanced_recovery", settings={**_STAMPED, "low_pass_filter": _LOSSES})
class _AdvancedRecovery:
    """Messages that were lost on the way are fetched again after the next heartbeat."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        publisher = advanced_publisher(end, "lossy")
        end.meet()
        publisher.put("0")
        for number in range(1, 6):
            publisher.put(f"{number}{_LARGE}")
        end.together("done")

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inbox, plain = advanced_subscriber(end, "lossy", recovery=True), end.subscribe("lossy")
        end.meet()
        seen = [sequence(inbox.wait(lambda samples: len(samples) >= 6, 2.0)), sequence(plain.wait(bool))]
        end.together("done")
        return seen


@scenario("advanced_misses", settings={**_STAMPED, "low_pass_filter": _LOSSES})
class _AdvancedMisses:
    """Messages that were lost and that nobody keeps are reported as missed."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        publisher = advanced_publisher(end, "lossy", cache=None)
        end.meet()
        for text in ("0", *(f"{number}{_LARGE}" for number in range(1, 6)), "6"):
            publisher.put(text)
        end.together("done")

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inbox, missed = advanced_subscriber(end, "lossy", recovery=True), CallCollector()
        listener = inbox.handle.sample_miss_listener(missed)
        end.meet()
        misses = [miss.nb for miss in missed.wait(lambda seen: sum(miss.nb for miss in seen) >= 5, 2.0)]
        end.together("done")
        return [sum(misses), sequence(inbox.wait(lambda samples: len(samples) >= 2)), listener is not None]


@scenario("mixed_publishers", settings=_STAMPED)
class _MixedPublishers:
    """Plain publishers, stamping or not, to an advanced subscriber with history and recovery."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        unstamped = end.open(timestamping__enabled=False)
        end.meet(end.session, unstamped)
        for number in range(5):
            end.session.put(end.key("stamped"), str(number))
            unstamped.put(end.key("unstamped"), str(number))
        end.together("done")

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inboxes = [advanced_subscriber(end, rest, history=10, recovery=True) for rest in ("stamped", "unstamped")]
        end.meet()
        seen = [inbox.take(5, 3.0) for inbox in inboxes]
        end.together("done")
        return seen
