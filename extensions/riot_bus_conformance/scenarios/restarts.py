"""Components and routers that join, die and come back while others keep running."""

from __future__ import annotations

import threading
from typing import Any

from riot_bus_conformance.end import Observation, ScenarioEnd
from riot_bus_conformance.samples import END
from riot_bus_conformance.scenario import scenario

# a guess: a component is back soon after its router, without asking all the time
_RETRY = {
    "connect/timeout_ms": -1,
    "connect/retry": {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 1.5},
}


class _Traffic:
    """Publishes numbers without a pause, from a thread of its own."""

    def __init__(self, publisher: Any) -> None:
        self._publisher = publisher
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        number = 0
        while not self._stop.wait(0.0005):
            self._publisher.put(str(number))
            number += 1
        self._publisher.put(END)

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()


def _gapless(samples: list[Any]) -> dict[str, bool]:
    numbers = [int(sample.payload.to_string()) for sample in samples]
    return {"some": len(numbers) > 10, "gapless": numbers == list(range(numbers[0], numbers[0] + len(numbers)))}


@scenario("join_during_traffic")
class _JoinDuringTraffic(ScenarioEnd):
    """A subscriber that joins while messages flow gets all of them from the first that it gets."""

    def left(self) -> Observation:
        self.meet()
        traffic = _Traffic(self.publisher("x"))
        self.signal("flowing")
        self.wait("enough")
        traffic.stop()

    def right(self) -> Observation:
        self.meet()
        self.wait("flowing")
        inbox = self.subscribe("*", self.open())
        inbox.received(101)
        self.signal("enough")
        return _gapless(inbox.until_end())


@scenario("killed_subscriber")
class _KilledSubscriber(ScenarioEnd):
    """A subscriber is killed under traffic and comes back; another one is not disturbed."""

    def left(self) -> Observation:
        beside = self.subscribe("x", self.open())
        self.meet()
        traffic = _Traffic(self.publisher("x"))
        self.wait("receiving")
        self.kill_other(again=True)
        self.wait("receiving")
        traffic.stop()
        return _gapless(beside.until_end())

    def right(self) -> Observation:
        inbox = self.subscribe("x")
        if not self.life:
            self.meet()
        inbox.received(101)
        self.signal("receiving")
        return [self.life, _gapless(inbox.until_end(timeout=60.0))]


@scenario("killed_publisher")
class _KilledPublisher(ScenarioEnd):
    """A publisher is killed, and its next life publishes to the same subscriber."""

    def left(self) -> Observation:
        inbox = self.subscribe("x")
        self.meet()
        first = inbox.take(1)
        self.kill_other(again=True)
        return [first, inbox.shown()]

    def right(self) -> Observation:
        publisher = self.publisher("x")
        if not self.life:
            self.meet()
        self.matched(publisher)
        publisher.put(f"life {self.life}")
        if not self.life:
            self.wait("never", 60.0)
        publisher.put(END)
        return self.life


@scenario("router_restart", needs=("router",), settings=_RETRY)
class _RouterRestart(ScenarioEnd):
    """The router is restarted: components come back by themselves, with all that they have declared."""

    def left(self) -> Observation:
        publisher = self.publisher("x")
        self.meet()
        self.matched(publisher)
        publisher.put("before")
        self.wait("got")
        self.restart_router()
        self.signal("restarted")
        self.meet()
        self.matched(publisher)
        publisher.put("after")
        replies = [
            *self.session.get(self.key("service"), timeout=5.0),
            *self.session.liveliness().get(self.key("token"), timeout=5.0),
        ]
        publisher.put(END)
        return [reply.ok.payload.to_string() for reply in replies if reply.ok is not None]

    def right(self) -> Observation:
        inbox = self.subscribe("x")
        self.answer("service", lambda query: query.reply(query.key_expr, "answer"))
        self.token("token")
        self.meet()
        inbox.take(1)
        self.signal("got")
        self.wait("restarted")
        self.meet()
        return inbox.shown()
