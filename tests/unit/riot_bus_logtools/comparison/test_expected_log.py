from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.log.writer import LogWriter
from riot_bus.testing.capture import Capture
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, InconclusiveError
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.comparison.expected_log import difference_from

REGISTRY = TypeRegistry()


def message(number: int, x: float, key: str = "a") -> Message:
    return Message(number * 1_000_000, key, b'{"x": %f}' % x, sequence=number)


def written(path: Path, messages: list[Message]) -> Path:
    with LogWriter(path, registry=REGISTRY) as log:
        for one in messages:
            log.write(one)
    return path


def captured(messages: list[Message]) -> Capture:
    capture = Capture(REGISTRY)
    for one in messages:
        capture.write(one)
    return capture


def test_what_is_delivered_as_expected_is_the_same_whatever_else_there_is(tmp_path: Path) -> None:
    messages = [message(number, number) for number in range(5)]
    log = written(tmp_path / "log.mcap", messages)
    later = [one.with_(time=one.time + 10**9, sequence=one.sequence + 100) for one in messages]
    assert difference_from(log, captured([*later, message(9, 9, "other")]), REGISTRY).same


def test_a_value_is_the_same_within_its_tolerance(tmp_path: Path) -> None:
    log = written(tmp_path / "log.mcap", [message(number, number) for number in range(5)])
    capture = captured([message(number, number + 0.1) for number in range(5)])
    assert not difference_from(log, capture, REGISTRY).same
    assert difference_from(log, capture, REGISTRY, tolerances=["a:x=0.2"]).same


def test_what_does_not_come_is_waited_for_and_then_a_difference(tmp_path: Path) -> None:
    log = written(tmp_path / "log.mcap", [message(number, number) for number in range(5)])
    found = difference_from(log, captured([message(number, number) for number in range(4)]), REGISTRY, timeout=0.01)
    assert not found.same
    assert any("1 lost" in line for line in found.lines())


def test_that_nothing_comes_is_a_difference(tmp_path: Path) -> None:
    log = written(tmp_path / "log.mcap", [message(number, number) for number in range(3)])
    found = difference_from(log, captured([]), REGISTRY, timeout=0.01)
    assert not found.same
    assert any("3 lost" in line for line in found.lines())


def test_nothing_to_compare_is_no_pass(tmp_path: Path) -> None:
    log = written(tmp_path / "log.mcap", [message(0, 0)])
    with pytest.raises((ConfigError, InconclusiveError)):
        difference_from(log, captured([]), REGISTRY, topics=["b"], timeout=0.01)


def test_topics_are_matched_by_their_names_where_keys_differ(tmp_path: Path) -> None:
    log = written(tmp_path / "log.mcap", [message(number, number, "/a") for number in range(3)])
    assert difference_from(log, captured([message(number, number) for number in range(3)]), REGISTRY, timeout=0.01).same
    with_key = [message(number, number + 1) for number in range(3)] + [message(n, n, "/a") for n in range(3)]
    assert difference_from(log, captured(with_key), REGISTRY, timeout=0.01).same


def test_calls_of_services_are_left_out(tmp_path: Path) -> None:
    log = written(tmp_path / "log.mcap", [message(0, 0), message(1, 1, "add/@request"), message(2, 2, "add/@reply")])
    assert difference_from(log, captured([message(0, 0)]), REGISTRY).same


def test_types_of_the_log_are_those_that_are_said(tmp_path: Path) -> None:
    log = written(tmp_path / "log.mcap", [message(0, 0)])
    with pytest.raises(ConfigError, match="unknown message type 'Pose'"):
        difference_from(log, captured([message(0, 0)]), REGISTRY, types=["a=Pose"])
