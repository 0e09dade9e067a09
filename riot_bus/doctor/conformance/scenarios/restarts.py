"""Components and routers that join, die and come back while others keep running."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from riot_bus.doctor.conformance.samples import END
from riot_bus.doctor.conformance.scenario import Observation, scenario

if TYPE_CHECKING:
    from collections.abc import Iterator

    from riot_bus.doctor.conformance.end import ScenarioEnd


_RETRY = {
    "connect/timeout_ms": -1,
    "connect/retry": {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 1.5},
}


class _Traffic:
    """Publishes numbers without a pause, from a thread of its own."""

    def __init__(self, end: ScenarioEnd) -> None:
        from riot_bus.zenoh import api as zenoh

        block = zenoh.CongestionControl.BLOCK
        self._publisher = end.session.declare_publisher(end.key("x"), congestion_control=block)
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
class _JoinDuringTraffic:
    """A subscriber that joins while messages flow gets all of them from the first that it gets."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        end.meet()
        traffic = _Traffic(end)
        end.signal("flowing")
        end.wait("enough")
        traffic.stop()
        end.together("done")

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        end.meet()
        end.wait("flowing")
        inbox = end.subscribe("*", end.open())
        inbox.wait(lambda samples: len(samples) > 100)
        end.signal("enough")
        seen = _gapless(inbox.until_end())
        end.together("done")
        return seen


@scenario("killed_subscriber")
class _KilledSubscriber:
    """A subscriber is killed under traffic and comes back; another one is not disturbed."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        beside = end.subscribe("x", end.open())
        end.meet()
        traffic = _Traffic(end)
        end.wait("receiving")
        end.kill_other(again=True)
        end.wait("receiving")
        traffic.stop()
        seen = _gapless(beside.until_end())
        end.together("done")
        return seen

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inbox = end.subscribe("x")
        if not end.life:
            end.meet()
        inbox.wait(lambda samples: len(samples) > 100)
        end.signal("receiving")
        seen = [end.life, _gapless(inbox.until_end(timeout=60.0))]
        end.together("done")
        return seen


@scenario("killed_publisher")
class _KilledPublisher:
    """A publisher is killed, and its next life publishes to the same subscriber."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        inbox = end.subscribe("x")
        end.meet()
        first = inbox.take(1)
        end.kill_other(again=True)
        seen = inbox.shown()
        end.together("done")
        return [first, seen]

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        publisher = end.session.declare_publisher(end.key("x"))
        if not end.life:
            end.meet()
        end.matched(publisher)
        publisher.put(f"life {end.life}")
        if not end.life:
            end.wait("never", 60.0)
        publisher.put(END)
        end.together("done")
        return end.life


@scenario("router_restart", needs=("router",), settings=_RETRY)
class _RouterRestart:
    """The router is restarted: components come back by themselves, with all that they have declared."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        publisher = end.session.declare_publisher(end.key("x"))
        end.meet()
        end.matched(publisher)
        publisher.put("before")
        end.wait("got")
        end.restart_router()
        end.signal("restarted")
        end.meet()
        end.matched(publisher)
        publisher.put("after")
        replies = [reply.ok.payload.to_string() for reply in _asked(end) if reply.ok is not None]
        publisher.put(END)
        end.together("done")
        return replies

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        def answer(query: Any) -> None:
            with query:
                query.reply(query.key_expr, "answer")

        inbox = end.subscribe("x")
        queryable = end.session.declare_queryable(end.key("service"), answer)
        token = end.session.liveliness().declare_token(end.key("token"))
        end.meet()
        inbox.take(1)
        end.signal("got")
        end.wait("restarted")
        end.meet()
        seen = inbox.shown()
        end.together("done")
        return [seen, queryable is not None, token is not None]


def _asked(end: ScenarioEnd) -> Iterator[Any]:
    yield from end.session.get(end.key("service"), timeout=5.0)
    yield from end.session.liveliness().get(end.key("token"), timeout=5.0)
