from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest

from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogWriter
from riot_bus.pipeline.event import Change
from riot_bus.testing.capture import Capture
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.message import Message

CHANGED = (Change("test", "set", "x", 1, 2),)


def message(x: object = 1, key: str = "a", sequence: int = 0) -> Message:
    return Message(1_000, key, f'{{"x": {x}}}'.encode(), sequence=sequence)


def capture(*, most_bytes: int = 1 << 20) -> Capture:
    return Capture(TypeRegistry(), most_bytes=most_bytes)


def test_what_was_sent_is_told_from_what_was_delivered() -> None:
    one = capture()
    one.write(message(0, sequence=1))
    one.write(message(1, sequence=2), role="original", changes=CHANGED)
    one.write(message(2, sequence=2), changes=CHANGED)
    assert [each.read("x") for each in one.sent("a")] == [0, 1]
    assert [each.read("x") for each in one.delivered("a")] == [0, 2]
    assert one.delivered("a")[1].changes == CHANGED


def test_messages_are_chosen_by_key_expression_and_by_value() -> None:
    one = capture()
    for x, key in ((1, "robot/a"), (5, "robot/b"), (6, "other")):
        one.write(message(x, key))
    assert [each.message.key for each in one.delivered("robot/*")] == ["robot/a", "robot/b"]
    assert [each.read("x") for each in one.delivered("** where x > 4")] == [5, 6]
    with pytest.raises(ConfigError, match=r"read\('x'\)"):
        one.delivered("robot/a:x")


def test_a_field_that_is_not_there_and_a_payload_without_a_type_are_told() -> None:
    one = capture()
    one.write(message())
    one.write(Message(0, "b", b"\x00\x01"))
    with pytest.raises(PayloadError):
        one.delivered("a")[0].read("y")
    with pytest.raises(ConfigError, match="riot_types"):
        one.delivered("b")[0].read("x")


def test_elements_of_an_array_can_be_read() -> None:
    one = capture()
    one.write(message([1, 5, 3]))
    assert one.delivered("a")[0].read("max(x[*])") == 5
    assert list(one.delivered("a")[0].read("x[*]")) == [1, 5, 3]


def test_it_waits_for_messages_that_come_later() -> None:
    one = capture()
    threading.Timer(0.05, lambda: [one.write(message(x)) for x in range(3)]).start()
    assert len(one.wait_for("a", 3)) >= 3


def test_an_event_loop_goes_on_meanwhile() -> None:
    one = capture()

    async def both() -> int:
        waiting = asyncio.create_task(one.arrived("a", 2))
        for x in range(2):
            one.write(message(x))
            await asyncio.sleep(0)
        return len(await waiting)

    assert asyncio.run(both()) == 2


def test_what_does_not_come_in_time_is_a_failure_that_says_what_came() -> None:
    one = capture()
    one.write(message(key="b"))
    with pytest.raises(AssertionError, match=r"0 of 2 messages of a within 0.01 s; delivered: b 1"):
        one.wait_for("a", 2, timeout=0.01)


def test_memory_is_bounded_and_what_was_given_up_is_counted() -> None:
    one = capture(most_bytes=10_000)
    for x in range(100):
        one.write(message(x))
    with pytest.raises(AssertionError, match=r"not in memory any more, but in the log: \{'a': 8\d\}"):
        one.delivered("a")
    one.write(message(1, "rare"))
    for x in range(100):
        one.write(message(x))
    assert len(one.delivered("rare")) == 1
    one.forget()
    assert one.delivered("rare") == []


def test_what_came_before_a_mark_is_left_out() -> None:
    one = capture()
    one.write(message(1))
    mark = one.mark()
    one.write(message(2))
    assert [each.read("x") for each in one.wait_for("a", since=mark)] == [2]
    with pytest.raises(AssertionError, match=r"0 of 1 messages of a within 0\.01 s; delivered: nothing"):
        one.wait_for("a", since=one.mark(), timeout=0.01)


def test_a_message_without_the_field_does_not_match() -> None:
    one = capture()
    one.write(Message(0, "a", b'{"y": 1}'))
    one.write(Message(0, "a", b"", kind="delete"))
    one.write(message(5))
    assert [each.payload for each in one.delivered("a where x > 3")] == [b'{"x": 5}']


def test_a_message_with_different_fates_was_sent_once() -> None:
    one = capture()
    one.write(message(1, sequence=3), role="original", changes=CHANGED)
    one.write(message(2, sequence=3), changes=CHANGED)
    one.write(message(1, sequence=3))
    assert [each.read("x") for each in one.sent("a")] == [1]
    assert len(one.delivered("a")) == 2


def test_many_may_wait_in_one_event_loop_and_give_up_in_time() -> None:
    one = capture()

    async def main() -> list[int]:
        waiting = [asyncio.create_task(one.arrived("a", timeout=60)) for _ in range(100)]
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(one.arrived("never", timeout=60), 0.01)
        with pytest.raises(AssertionError, match="0 of 1 messages of never"):
            await one.arrived("never", timeout=0.01)
        await asyncio.to_thread(one.write, message())
        return [len(found) for found in await asyncio.gather(*waiting)]

    assert asyncio.run(main()) == [1] * 100


def test_a_log_gets_all_of_it(tmp_path: Path) -> None:
    registry = TypeRegistry()
    one = Capture(registry, LogWriter(tmp_path / "a.mcap", registry=registry))
    one.write(message(1), role="original", changes=CHANGED)
    one.write(message(2), changes=CHANGED)
    one.note("test", {"a": "b"})
    one.renew("a")
    one.tick()
    one.flush()
    assert (one.problem, one.refused) == ("", 0)
    one.close()
    with LogReader(tmp_path / "a.mcap") as log:
        assert [each.payload for each in log.messages()] == [b'{"x": 2}']
