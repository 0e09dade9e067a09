"""Advanced publishers and subscribers: history, detection and losses. Every topic of rmw_zenoh is one of these."""

from __future__ import annotations

from riot_bus.zenoh.session import wait_until
from riot_bus_conformance.end import Observation, ScenarioEnd
from riot_bus_conformance.samples import CallCollector, Inbox, sequence
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


@scenario("advanced_live", settings=_STAMPED)
class _AdvancedLive(ScenarioEnd):
    """Live messages from an advanced publisher to an advanced and to a plain subscriber."""

    def left(self) -> Observation:
        publisher = self.advanced_publisher("x")
        self.meet()
        for number in range(10):
            publisher.put(str(number), encoding="text/plain", attachment=b"a")
        publisher.delete()

    def right(self) -> Observation:
        advanced, plain = self.advanced_subscriber("x", recovery=True), self.subscribe("x")
        self.meet()
        return [sequence(inbox.received(11, 3.0)) for inbox in (advanced, plain)]


@scenario("advanced_history", settings=_STAMPED)
class _AdvancedHistory(ScenarioEnd):
    """Late joiners get the history, as deep as they want and the publisher keeps, then the live messages, once."""

    def left(self) -> Observation:
        publisher = self.advanced_publisher("x", cache=5)
        for number in range(8):
            publisher.put(str(number))
        self.meet()
        self.wait("joined")
        publisher.put("live")

    def right(self) -> Observation:
        self.meet()
        # A subscriber that joins while the first messages are still on their way gets those as well.
        wait_until(lambda: self._cached()[-1:] == ["7"], 5.0)
        deep, shallow = self.advanced_subscriber("x", history=100), self.advanced_subscriber("x", history=2)
        deep.take(5, 1.0)
        shallow.take(2, 1.0)
        self.signal("joined")
        return {"deep": sequence(deep.received(6, 1.0)), "shallow": sequence(shallow.received(3, 1.0))}

    def _cached(self) -> list[str]:
        """Return the texts in the publisher's cache, as late joiners would get them now."""
        replies = self.session.get(f"{self.key('x')}/@adv/**", timeout=1.0)
        return [reply.ok.payload.to_string() for reply in replies if reply.ok]


@scenario("advanced_late_publisher", settings=_STAMPED)
class _AdvancedLatePublisher(ScenarioEnd):
    """A publisher that comes after the subscriber, having published before anybody could hear it."""

    def left(self) -> Observation:
        self.meet()
        publisher = self.advanced_publisher("x", self.open())
        for number in range(3):
            publisher.put(str(number))
        self.wait("got")
        publisher.put("live")

    def right(self) -> Observation:
        inbox = self.advanced_subscriber("x", history=10, recovery=True)
        self.meet()
        inbox.take(3, 1.0)
        self.signal("got")
        return sequence(inbox.received(4, 1.0))


@scenario("advanced_detection", settings=_STAMPED)
class _AdvancedDetection(ScenarioEnd):
    """Advanced publishers and subscribers that are found by their liveliness tokens."""

    def left(self) -> Observation:
        publisher, tokens = self.advanced_publisher("x"), self.tokens("x/@adv/sub/**", history=True)
        self.meet()
        seen = len(tokens.take(1, 3.0))
        self.wait("found")
        publisher.undeclare()
        return seen

    def right(self) -> Observation:
        inbox, found = self.advanced_subscriber("x", history=1), Inbox()
        self.keep(inbox.handle.detect_publishers(found, history=True))
        self.meet()
        found.take(1, 3.0)
        self.signal("found")
        return [int(sample.kind) for sample in found.received(2, 3.0)]


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
