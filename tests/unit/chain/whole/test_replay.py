from __future__ import annotations

from pathlib import Path
from typing import Any

from riot_bus.chain.whole.driven_system import DrivenSystem
from riot_bus.chain.whole.replay import Replay, replay
from riot_bus.inject.apply import inject_log
from riot_bus.log.reader import read_log
from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.trial import TestCase
from tests.unit.chain.machine import (
    COUNT,
    LOGGED,
    SYSTEM,
    bench,
    hangs,
    panel,
    said,
    share,
    write_minimal,
    write_nominal,
    write_rule,
)

SLOW = Injection("panel", "knob", 5.0, first=30, last=33)


def driven(folder: Path, system: str = LOGGED, **machine: Any) -> DrivenSystem:
    write_nominal(folder)
    one = bench(folder, system, **machine)
    write_minimal(one)
    write_rule(one)
    return DrivenSystem(one.run(), one.folder, ())


def test_one_message_of_many_is_enough(tmp_path: Path) -> None:
    system = driven(tmp_path)
    case = TestCase(tuple(panel(0)), (SLOW,))
    assert replay(system, case, None) == Replay(COUNT, 10, 10, 1, proven=True)
    assert len(read_log(system.folder / "activation.mcap")) == COUNT
    (kept,) = read_log(system.folder / "activation-minimal.mcap")
    assert said(kept)["knob"] == 5.0


def test_what_external_components_said_is_kept_as_it_was(tmp_path: Path) -> None:
    system = driven(tmp_path, SYSTEM)
    messages, _ = inject_log(panel(0), [SLOW], registry=TypeRegistry())
    with LogWriter(tmp_path / "external.mcap") as writer:
        for message in messages:
            writer.write(message)
    found = replay(system, TestCase((), (SLOW,)), str(tmp_path / "external.mcap"))
    assert (found.messages, found.failed, found.needed) == (COUNT, 10, 1)


def test_without_a_log_there_is_nothing_to_replay(tmp_path: Path) -> None:
    system = driven(tmp_path, SYSTEM)
    assert replay(system, TestCase((), (SLOW,)), None) == replay(system, None, None) == Replay()
    assert not (system.folder / "activation.mcap").exists()


def test_of_a_failure_that_replays_seldom_nothing_more_is_asked(tmp_path: Path) -> None:
    system = driven(tmp_path, system_wrong=lambda case: share(case) < 0.7)
    found = replay(system, TestCase(tuple(panel(0)), (SLOW,)), None)
    assert 0 < found.failed < 9
    assert (found.needed, found.proven) == (0, False)
    assert not (system.folder / "activation-minimal.mcap").exists()


def test_a_failure_that_needs_several_messages_keeps_them(tmp_path: Path) -> None:
    def after_two(messages: Any) -> int | None:
        place = hangs(messages)
        return place if place is not None and len(messages) >= 3 else None

    system = driven(tmp_path, system_fails=after_two)
    found = replay(system, TestCase(tuple(panel(0)), (SLOW,)), None)
    assert (found.failed, found.needed) == (10, 3)
