"""Quality of service of samples, and their timestamps and source information."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.doctor.conformance.helpers import (
    finish,
    put,
)
from riot_bus.doctor.conformance.scenario import Observation, scenario

if TYPE_CHECKING:
    from riot_bus.doctor.conformance.end import ScenarioEnd

_COMBINATIONS = 7 * 3 * 2  # Zenoh's priorities, its congestion controls, and express or not


@scenario("quality_of_service")
class _QualityOfService:
    """Every priority with every congestion control, express or not."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh

        levels: Any = zenoh
        end.meet()
        number = 0
        for priority in ("REAL_TIME", "INTERACTIVE_HIGH", "INTERACTIVE_LOW", "DATA_HIGH", "DATA", "DATA_LOW"):
            number += _each_control(end, getattr(levels.Priority, priority), number)
        number += _each_control(end, levels.Priority.BACKGROUND, number)
        finish(end)
        return number

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inbox = end.subscribe("**")
        end.meet()
        for count in range(_COMBINATIONS):
            inbox.take(count + 1)
            end.signal("got")
        return inbox.shown()


def _each_control(end: ScenarioEnd, priority: Any, number: int) -> int:
    from riot_bus.zenoh import api as zenoh

    controls: Any = zenoh.CongestionControl
    options = [(control, express) for control in ("DROP", "BLOCK", "BLOCK_FIRST") for express in (False, True)]
    for index, (control, express) in enumerate(options):
        text = f"{number + index:02}"
        congestion = getattr(controls, control)
        end.session.put(end.key("q"), text, priority=priority, congestion_control=congestion, express=express)
        end.wait("got")  # without a pause, a full queue would justify losses under DROP
    return len(options)


@scenario("publisher_options")
class _PublisherOptions:
    """A publisher's own encoding and quality of service, best effort and reliable."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh

        publishers = [
            end.session.declare_publisher(
                end.key(f"p/{reliability}"),
                encoding="text/csv",
                priority=zenoh.Priority.DATA_HIGH,
                congestion_control=zenoh.CongestionControl.BLOCK,
                express=True,
                reliability=reliability,
            )
            for reliability in (zenoh.Reliability.BEST_EFFORT, zenoh.Reliability.RELIABLE)
        ]
        end.meet()
        for publisher in publishers:
            end.matched(publisher)
            publisher.put("1")
            publisher.put("2", encoding="text/plain")
        end.wait("all")
        finish(end)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inbox = end.subscribe("**")
        end.meet()
        inbox.take(4)
        end.signal("all")
        return sorted(inbox.shown(), key=str)


@scenario(
    "stamps",
    limits={
        "intercepted": "stamps and sources are not copied: advanced subscribers would drop what is late or repeated"
    },
)
class _Stamps:
    """A publisher's own timestamp and source information."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh

        publisher = end.session.declare_publisher(end.key("x"))
        end.meet()
        end.matched(publisher)
        stamp = end.session.new_timestamp()
        end.signal("stamp", str(stamp))
        put(end, "x", "stamped", timestamp=stamp)
        put(end, "x", "sourced", source_info=zenoh.SourceInfo(publisher.id, 7))
        publisher.put("neither")
        finish(end)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        inbox = end.subscribe("**")
        end.meet()
        stamp = end.wait("stamp")
        samples = inbox.until_end()
        return {
            "same stamp": [sample.timestamp is not None and str(sample.timestamp) == stamp for sample in samples],
            "sequence": [sample.source_info and sample.source_info.source_sn for sample in samples],
        }
