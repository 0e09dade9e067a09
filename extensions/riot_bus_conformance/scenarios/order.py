"""Many topics, many messages, several publishers: nothing lost, doubled or out of order."""

from __future__ import annotations

import threading

from riot_bus_conformance.end import Observation, ScenarioEnd, Session
from riot_bus_conformance.samples import END, keys_of
from riot_bus_conformance.scenario import scenario

_TOPICS = 1000  # as the name of the scenario says; each costs two declarations and a message
_EACH = 500  # a guess: enough for two publishers to interleave, and soon sent
_BURST = 5000  # 5 MB, 77 batches of Zenoh: queues fill, and the publisher waits


def _counted(numbers: list[int], expected: int) -> dict[str, object]:
    return {"count": len(numbers), "complete and in order": numbers == list(range(expected))}


@scenario("thousand_topics")
class _ThousandTopics(ScenarioEnd):
    """A thousand topics, each with a publisher and a subscriber of its own."""

    def left(self) -> Observation:
        publishers = [self.publisher(f"t/{number}") for number in range(_TOPICS)]
        self.meet()
        for publisher in publishers:
            self.matched(publisher)
        for number, publisher in enumerate(publishers):
            publisher.put(str(number))
        self.finish()

    def right(self) -> Observation:
        inboxes = [self.subscribe(f"t/{number}") for number in range(_TOPICS)]
        closing = self.subscribe("end")
        self.meet()
        closing.until_end()
        return [keys_of(inbox.wait()) for inbox in inboxes]


@scenario("two_publishers")
class _TwoPublishers(ScenarioEnd):
    """Two sessions that publish on one topic at once: each one's order is kept, nothing is lost or doubled."""

    def left(self) -> Observation:
        sessions = [self.open(), self.open()]
        self.meet(*sessions)
        threads = [threading.Thread(target=self._publish, args=(each, n)) for n, each in enumerate(sessions)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    def right(self) -> Observation:
        inbox = self.subscribe("**")
        self.meet()
        texts = [sample.payload.to_string() for sample in inbox.until_end(2)]
        return {name: _counted([int(text[2:]) for text in texts if text[0] == name], _EACH) for name in "01"}

    def _publish(self, session: Session, name: int) -> None:
        publisher = self.publisher("topic", session)
        self.matched(publisher)
        for number in range(_EACH):
            publisher.put(f"{name}:{number}")
        publisher.put(END)


@scenario("both_ways")
class _BothWays(ScenarioEnd):
    """Both ends publish and subscribe on one key: each sees its own and the other's messages, once."""

    def left(self) -> Observation:
        inbox = self.subscribe("**")
        self.meet()
        for number in range(100):
            self.put("x", f"{self.name} {number}")
        self.finish("x")
        inbox.until_end(2)
        self.together("seen")
        texts = [sample.payload.to_string() for sample in inbox.wait()]
        return {side: [text for text in texts if text.startswith(side)] for side in ("left", "right", END.decode())}

    right = left


@scenario("burst")
class _Burst(ScenarioEnd):
    """Thousands of messages as fast as possible: all arrive, in order."""

    def left(self) -> Observation:
        publisher = self.publisher("x")
        self.meet()
        self.matched(publisher)
        for number in range(_BURST):
            publisher.put(number.to_bytes(8, "big") + bytes(1000))
        publisher.put(END)

    def right(self) -> Observation:
        inbox = self.subscribe("x")
        self.meet()
        return _counted([int.from_bytes(sample.payload.to_bytes()[:8], "big") for sample in inbox.until_end()], _BURST)
