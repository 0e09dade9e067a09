"""Advanced publishers and subscribers: history and detection. Every topic of rmw_zenoh is one of these."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.doctor.conformance.helpers import (
    advanced_publisher,
    advanced_subscriber,
    cached,
    sequence,
)
from riot_bus.doctor.conformance.samples import Inbox
from riot_bus.doctor.conformance.scenario import Observation, scenario
from riot_bus.zenoh.session import wait_until

if TYPE_CHECKING:
    from riot_bus.doctor.conformance.end import ScenarioEnd

_STAMPED = {"timestamping/enabled": True}


@scenario("advanced_live", settings=_STAMPED)
class _AdvancedLive:
    """Live messages from an advanced publisher to an advanced and to a plain subscriber."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        publisher = advanced_publisher(end, "x")
        end.meet()
        for number in range(10):
            publisher.put(str(number), encoding="text/plain", attachment=b"a")
        publisher.delete()
        end.together("done")

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        advanced, plain = advanced_subscriber(end, "x", recovery=True), end.subscribe("x")
        end.meet()
        enough = 11
        seen = [sequence(inbox.wait(lambda samples: len(samples) >= enough, 3.0)) for inbox in (advanced, plain)]
        end.together("done")
        return seen


@scenario("advanced_history", settings=_STAMPED)
class _AdvancedHistory:
    """Late joiners get the history, as deep as they want and the publisher keeps, then the live messages, once."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        publisher = advanced_publisher(end, "x", cache=5)
        for number in range(8):
            publisher.put(str(number))
        end.meet()
        end.wait("joined")
        publisher.put("live")
        end.together("done")

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        end.meet()
        # A subscriber that joins while the first messages are still on their way gets those as well.
        wait_until(lambda: cached(end, "x")[-1:] == ["7"], 5.0)
        deep, shallow = advanced_subscriber(end, "x", history=100), advanced_subscriber(end, "x", history=2)
        deep.take(5, 1.0)
        shallow.take(2, 1.0)
        end.signal("joined")
        seen = {
            "deep": sequence(deep.wait(lambda samples: len(samples) >= 6, 1.0)),
            "shallow": sequence(shallow.wait(lambda samples: len(samples) >= 3, 1.0)),
        }
        end.together("done")
        return seen


@scenario("advanced_late_publisher", settings=_STAMPED)
class _AdvancedLatePublisher:
    """A publisher that comes after the subscriber, having published before anybody could hear it."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        end.meet()
        late = end.open()
        publisher = advanced_publisher(end, "x", session=late)
        for number in range(3):
            publisher.put(str(number))
        end.wait("got")
        publisher.put("live")
        end.together("done")

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inbox = advanced_subscriber(end, "x", history=10, recovery=True)
        end.meet()
        inbox.take(3, 1.0)
        end.signal("got")
        seen = sequence(inbox.wait(lambda samples: len(samples) >= 4, 1.0))
        end.together("done")
        return seen


@scenario("advanced_detection", settings=_STAMPED)
class _AdvancedDetection:
    """Advanced publishers and subscribers that are found by their liveliness tokens."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        tokens = Inbox()
        publisher = advanced_publisher(end, "x")
        listener = end.session.liveliness().declare_subscriber(end.key("x/@adv/sub/**"), tokens, history=True)
        end.meet()
        seen = len(tokens.take(1, 3.0))
        end.wait("found")
        publisher.undeclare()
        end.together("done")
        return [seen, listener is not None]

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inbox, found = advanced_subscriber(end, "x", history=1), Inbox()
        listener = inbox.handle.detect_publishers(found, history=True)
        end.meet()
        found.take(1, 3.0)
        end.signal("found")
        seen = [int(sample.kind) for sample in found.wait(lambda samples: len(samples) >= 2, 3.0)]
        end.together("done")
        return [seen, listener is not None]
