from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from riot_bus.pipeline.runner import Emission, Result
from riot_bus.zenoh.convert import SampleArrival
from tests.unit.router.fake_bus import FakeBus, Recorder, eventually, message, sample

LONG_NS = 3600 * 1_000_000_000


class Worker:
    def take_over(self) -> None:
        raise AssertionError


def arrival(bus: FakeBus, payload: bytes, key: str = "cut/a") -> SampleArrival:
    return SampleArrival(sample(payload, key), key, 5_000, bus.access.converters["system"])


def delayed(by_ns: int) -> Callable[[Any], None]:
    def act(event: Any) -> None:
        event.delay(by_ns / 1e9)

    return act


def test_a_message_that_passes_is_forwarded_by_its_forwarder_and_recorded() -> None:
    bus, recorder = FakeBus(), Recorder()
    answer = bus.deliveries.feed("cut/a", arrival(bus, b"0"), Worker())
    assert (answer.payload, answer.result) == (None, None)
    bus.deliveries.surround(recorder=recorder)
    bus.deliveries.feed("cut/a", arrival(bus, b"1"), Worker())
    assert recorder.rows == [("delivered", b"1", 5_000)]


def test_a_changed_message_is_recorded_before_and_after() -> None:
    def act(event: Any) -> None:
        event.replace(b"new")

    bus, recorder = FakeBus(act), Recorder()
    bus.deliveries.surround(recorder=recorder)
    answer = bus.deliveries.feed("cut/a", arrival(bus, b"old"), Worker())
    assert answer.payload == b"new"
    assert [row[:2] for row in recorder.rows] == [("original", b"old"), ("delivered", b"new")]


def test_what_is_due_is_published_at_once_and_the_rest_is_held_until_it_is_due() -> None:
    bus, recorder = FakeBus(delayed(50_000_000)), Recorder()
    bus.deliveries.surround(recorder=recorder)
    bus.deliveries.start()
    now = time.time_ns()
    bus.deliveries.send(message(b"late", time=now))
    assert bus.deliveries.held() == {"/cut/a": 1}
    assert bus.outlet.messages == []
    assert eventually(lambda: not bus.deliveries.held())
    assert [each.payload for each in bus.outlet.messages] == [b"late"]
    assert recorder.rows[-1] == ("delivered", b"late", now + 50_000_000)
    bus.close()


def test_what_is_held_at_the_end_is_counted_as_lost() -> None:
    bus = FakeBus(delayed(LONG_NS))
    bus.deliveries.send(message(time=time.time_ns()))
    bus.close()
    assert bus.deliveries.held() == {}
    assert bus.deliveries.losses() == {"held at the end": {"/cut/a": 1}}


def test_a_message_that_cannot_be_published_is_counted_and_not_recorded() -> None:
    bus, recorder = FakeBus(), Recorder()
    bus.deliveries.surround(recorder=recorder)
    bus.deliveries.send(message(b"refused"))
    assert bus.deliveries.losses() == {"not published": {"/cut/a": 1}}
    assert recorder.rows == []


def test_an_added_message_on_a_key_that_is_not_cut_is_published_once() -> None:
    bus = FakeBus()
    targets = ("system", "unit")
    cut, free = message(key="cut/b"), message(key="free/b")
    assert bus.deliveries.targets_of(Emission(0, cut, None, targets=targets)) == targets
    assert bus.deliveries.targets_of(Emission(0, free, None, targets=targets)) == targets[:1]
    assert bus.deliveries.targets_of(Emission(0, cut, message())) == ("unit",)


def test_messages_of_an_advanced_publisher_go_through_its_stream() -> None:
    class State:
        def __init__(self) -> None:
            self.rows: list[Any] = []

        def deliver(self, key: str, put: Callable[[], None]) -> None:
            self.rows.append(key)
            put()

        def publish(self, segment: str, message: Any) -> bool:
            self.rows.append((segment, message.payload))
            return True

    bus, state = FakeBus(), State()
    bus.deliveries.surround(stream_of=lambda original, each: state if each.key == "cut/a" else None)
    bus.deliveries.send(message(b"0"))
    bus.deliveries.send(message(b"1", "cut/b"))
    assert state.rows == ["cut/a", ("unit", b"0")]
    assert [each.payload for each in bus.outlet.messages] == [b"1"]


def test_a_history_is_stored_but_what_is_added_to_it_elsewhere_is_published() -> None:
    def act(event: Any) -> None:
        event.add(message(b"extra", "cut/other"))

    bus, recorder = FakeBus(act), Recorder()
    bus.deliveries.surround(recorder=recorder)
    kept = bus.deliveries.replay(message(b"old"), Worker())
    assert [each.message.payload for each in kept.emissions] == [b"old"]
    assert [each.payload for each in bus.outlet.messages] == [b"extra"]
    recorder.rows.clear()
    bus.deliveries.record(kept)
    assert [row[:2] for row in recorder.rows] == [("original", b"old"), ("delivered", b"old")]


def test_treatment_says_who_has_to_see_messages() -> None:
    bus = FakeBus()

    def treatment(*, advanced: bool = False) -> tuple[bool, bool]:
        found = bus.deliveries.treatment("cut/a", lambda: b"", advanced=advanced)
        assert found.rewrite is None
        return found.inspected, found.advanced

    assert treatment() == (False, False)
    assert treatment(advanced=True) == (True, True)
    bus.deliveries.surround(recorder=Recorder())
    assert treatment() == (True, False)


def test_observed_segments_and_other_surroundings_are_replaced_not_changed() -> None:
    bus = FakeBus()
    before = bus.deliveries.surroundings
    bus.deliveries.observe("unit")
    bus.deliveries.observe("system")
    assert before.observed == frozenset()
    assert bus.deliveries.surroundings.observed == {"unit", "system"}
    assert bus.deliveries.owner("cut/a") == "cut/**"
    assert bus.deliveries.owner("free/a") is None


def test_a_result_with_nothing_to_deliver_publishes_nothing() -> None:
    bus = FakeBus()
    bus.deliveries.deliver(Result(message(), ()))
    assert bus.outlet.messages == []
