"""Advanced publishers and subscribers whose messages get lost, or that talk to plain ones."""

from __future__ import annotations

from riot_bus_conformance.end import Observation, ScenarioEnd
from riot_bus_conformance.samples import CallCollector, sequence
from riot_bus_conformance.scenario import scenario

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

_LARGE = tuple(f"{number}{'x' * 200}" for number in range(1, 6))


@scenario("advanced_recovery", settings={**_STAMPED, "low_pass_filter": _LOSSES})
class _AdvancedRecovery(ScenarioEnd):
    """Messages that were lost on the way are fetched again after the next heartbeat."""

    def left(self) -> Observation:
        publisher = self.advanced_publisher("lossy")
        self.meet()
        for text in ("0", *_LARGE):
            publisher.put(text)

    def right(self) -> Observation:
        inbox, plain = self.advanced_subscriber("lossy", recovery=True), self.subscribe("lossy")
        self.meet()
        return [sequence(inbox.received(6, 2.0)), sequence(plain.wait())]


@scenario("advanced_misses", settings={**_STAMPED, "low_pass_filter": _LOSSES})
class _AdvancedMisses(ScenarioEnd):
    """Messages that were lost and that nobody keeps are reported as missed."""

    def left(self) -> Observation:
        publisher = self.advanced_publisher("lossy", cache=None)
        self.meet()
        for text in ("0", *_LARGE, "6"):
            publisher.put(text)

    def right(self) -> Observation:
        inbox, missed = self.advanced_subscriber("lossy", recovery=True), CallCollector()
        self.keep(inbox.handle.sample_miss_listener(missed))
        self.meet()
        misses = [miss.nb for miss in missed.wait(lambda seen: sum(miss.nb for miss in seen) >= 5, 2.0)]
        return [sum(misses), sequence(inbox.received(2))]


@scenario("mixed_publishers", settings=_STAMPED)
class _MixedPublishers(ScenarioEnd):
    """Plain publishers, stamping or not, to an advanced subscriber with history and recovery."""

    def left(self) -> Observation:
        unstamped = self.open(timestamping__enabled=False)
        self.meet(self.session, unstamped)
        for number in range(5):
            self.session.put(self.key("stamped"), str(number))
            unstamped.put(self.key("unstamped"), str(number))

    def right(self) -> Observation:
        inboxes = [self.advanced_subscriber(rest, history=10, recovery=True) for rest in ("stamped", "unstamped")]
        self.meet()
        return [inbox.take(5, 3.0) for inbox in inboxes]
