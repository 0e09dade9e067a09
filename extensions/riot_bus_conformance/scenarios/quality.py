"""Quality of service of samples, and their timestamps and source information."""

from __future__ import annotations

from itertools import product
from typing import Any

from riot_bus.zenoh import api as zenoh
from riot_bus_conformance.end import Observation, ScenarioEnd
from riot_bus_conformance.scenario import scenario

_LEVELS: Any = zenoh.Priority
_CONTROLS: Any = zenoh.CongestionControl
_PRIORITIES = ("REAL_TIME", "INTERACTIVE_HIGH", "INTERACTIVE_LOW", "DATA_HIGH", "DATA", "DATA_LOW", "BACKGROUND")
_COMBINATIONS = tuple(product(_PRIORITIES, ("DROP", "BLOCK", "BLOCK_FIRST"), (False, True)))


@scenario("quality_of_service")
class _QualityOfService(ScenarioEnd):
    """Every priority with every congestion control, express or not."""

    def left(self) -> Observation:
        self.meet()
        for number, (priority, control, express) in enumerate(_COMBINATIONS):
            level, congestion = getattr(_LEVELS, priority), getattr(_CONTROLS, control)
            self.session.put(
                self.key("q"), f"{number:02}", priority=level, congestion_control=congestion, express=express
            )
            self.wait("got")  # without a pause, a full queue would justify losses under DROP
        self.finish()

    def right(self) -> Observation:
        inbox = self.subscribe("**")
        self.meet()
        for count in range(len(_COMBINATIONS)):
            inbox.take(count + 1)
            self.signal("got")
        return inbox.shown()


@scenario("publisher_options")
class _PublisherOptions(ScenarioEnd):
    """A publisher's own encoding and quality of service, best effort and reliable."""

    def left(self) -> Observation:
        options: dict[str, Any] = {"encoding": "text/csv", "priority": zenoh.Priority.DATA_HIGH, "express": True}
        publishers = [
            self.publisher(f"p/{reliability}", reliability=reliability, **options)
            for reliability in (zenoh.Reliability.BEST_EFFORT, zenoh.Reliability.RELIABLE)
        ]
        self.meet()
        for publisher in publishers:
            self.matched(publisher)
            publisher.put("1")
            publisher.put("2", encoding="text/plain")
        self.wait("all")
        self.finish()

    def right(self) -> Observation:
        inbox = self.subscribe("**")
        self.meet()
        inbox.take(4)
        self.signal("all")
        return sorted(inbox.shown(), key=str)


@scenario(
    "stamps",
    limits={
        "intercepted": "stamps and sources are not copied: advanced subscribers would drop what is late or repeated"
    },
)
class _Stamps(ScenarioEnd):
    """A publisher's own timestamp and source information."""

    def left(self) -> Observation:
        publisher = self.publisher("x")
        self.meet()
        self.matched(publisher)
        stamp = self.session.new_timestamp()
        self.signal("stamp", str(stamp))
        self.put("x", "stamped", timestamp=stamp)
        self.put("x", "sourced", source_info=zenoh.SourceInfo(publisher.id, 7))
        publisher.put("neither")
        self.finish()

    def right(self) -> Observation:
        inbox = self.subscribe("**")
        self.meet()
        stamp = self.wait("stamp")
        samples = inbox.until_end()
        return {
            "same stamp": [sample.timestamp is not None and str(sample.timestamp) == stamp for sample in samples],
            "sequence": [sample.source_info and sample.source_info.source_sn for sample in samples],
        }
