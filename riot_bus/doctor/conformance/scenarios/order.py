"""Many topics, many messages, several publishers: nothing lost, doubled or out of order."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from riot_bus.doctor.conformance.helpers import (
    keys_of,
)
from riot_bus.doctor.conformance.samples import END
from riot_bus.doctor.conformance.scenario import Observation, scenario

if TYPE_CHECKING:
    from riot_bus.doctor.conformance.end import ScenarioEnd

_TOPICS = 1000  # as the name of the scenario says; each costs two declarations and a message
_EACH = 500  # a guess: enough for two publishers to interleave, and soon sent
_BURST = 5000  # 5 MB, 77 batches of Zenoh: queues fill, and the publisher waits


@scenario("thousand_topics")
class _ThousandTopics:
    """A thousand topics, each with a publisher and a subscriber of its own."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh

        block = zenoh.CongestionControl.BLOCK
        keys = [end.key(f"t/{number}") for number in range(_TOPICS)]
        publishers = [end.session.declare_publisher(key, congestion_control=block) for key in keys]
        end.meet()
        for publisher in publishers:
            end.matched(publisher)
        for number, publisher in enumerate(publishers):
            publisher.put(str(number))
        end.session.put(end.key("end"), END, congestion_control=block)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inboxes = [end.subscribe(f"t/{number}") for number in range(_TOPICS)]
        closing = end.subscribe("end")
        end.meet()
        closing.until_end()
        return [keys_of(inbox.wait(bool)) for inbox in inboxes]


@scenario("two_publishers")
class _TwoPublishers:
    """Two sessions that publish on one topic at once: each one's order is kept, nothing is lost or doubled."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        sessions = [end.open(), end.open()]
        end.meet(*sessions)
        threads = [threading.Thread(target=_publish, args=(end, each, n)) for n, each in enumerate(sessions)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inbox = end.subscribe("**")
        end.meet()
        texts = [sample.payload.to_string() for sample in inbox.until_end(2)]
        by_publisher = {name: [int(text[2:]) for text in texts if text[0] == name] for name in "01"}
        return {
            name: {"count": len(numbers), "complete and in order": numbers == list(range(_EACH))}
            for name, numbers in by_publisher.items()
        }


def _publish(end: ScenarioEnd, session: Any, name: int) -> None:
    from riot_bus.zenoh import api as zenoh

    block = zenoh.CongestionControl.BLOCK
    publisher = session.declare_publisher(end.key("topic"), congestion_control=block)
    end.matched(publisher)
    for number in range(_EACH):
        publisher.put(f"{name}:{number}")
    publisher.put(END)


@scenario("both_ways")
class _BothWays:
    """Both ends publish and subscribe on one key: each sees its own and the other's messages, once."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh

        block = zenoh.CongestionControl.BLOCK
        inbox = end.subscribe("**")
        end.meet()
        for number in range(100):
            end.session.put(end.key("x"), f"{end.name} {number}", congestion_control=block)
        end.session.put(end.key("x"), END, congestion_control=block)
        inbox.wait(lambda samples: sum(sample.payload.to_bytes() == END for sample in samples) >= 2)
        end.together("seen")
        texts = [sample.payload.to_string() for sample in inbox.wait(bool)]
        return {side: [text for text in texts if text.startswith(side)] for side in ("left", "right", END.decode())}

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        return _BothWays.left(end)


@scenario("burst")
class _Burst:
    """Thousands of messages as fast as possible: all arrive, in order."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh

        block = zenoh.CongestionControl.BLOCK
        publisher = end.session.declare_publisher(end.key("x"), congestion_control=block)
        end.meet()
        end.matched(publisher)
        for number in range(_BURST):
            publisher.put(number.to_bytes(8, "big") + bytes(1000))
        publisher.put(END)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inbox = end.subscribe("x")
        end.meet()
        numbers = [int.from_bytes(sample.payload.to_bytes()[:8], "big") for sample in inbox.until_end()]
        return {"count": len(numbers), "complete and in order": numbers == list(range(_BURST))}
