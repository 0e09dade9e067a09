from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Mapping
from typing import Any

from riot_bus.log.account import LOST, Account, account_of
from riot_bus.log.recorded_file import RecordedFile
from riot_bus.log.writing_queue import LostMessagesError


class Memory:
    """A writer that only takes notes; flushing fails."""

    problem, refused = "", 0

    def __init__(self) -> None:
        self.notes: list[tuple[str, Mapping[str, str]]] = []
        self.closed = False

    def note(self, name: str, mapping: Mapping[str, str]) -> None:
        self.notes.append((name, mapping))

    def flush(self) -> None:
        lost = Counter({("k/a", "delivered"): 2, ("k/b", "original"): 1})
        raise LostMessagesError("full", where="x", lost=lost)  # type: ignore[arg-type]

    def close(self) -> None:
        self.closed = True


def test_losses_are_counted_reported_and_written_down() -> None:
    writer: Any = Memory()
    said: list[Exception] = []
    file = RecordedFile(
        writer, topic=lambda key: key[-1], lock=threading.RLock(), failed=lambda file, error: said.append(error)
    )
    file.counts.recorded.add("a", 5)
    file.finish()
    expected = Account({"a": 3}, {"disk": {"a": 2, "b": 1}})
    assert file.account() == expected
    assert [(name, account_of(note)) for name, note in writer.notes] == [(LOST, expected)]
    assert ([type(each) for each in said], writer.closed) == ([LostMessagesError], True)


def test_other_errors_are_reported_and_lose_nothing() -> None:
    said: list[Exception] = []
    file = RecordedFile(
        Memory(),  # type: ignore[arg-type,type-var]
        topic=str,
        lock=threading.RLock(),
        failed=lambda file, error: said.append(error),
    )
    file.attempt(lambda: 1 // 0)
    assert ([type(each) for each in said], file.account()) == ([ZeroDivisionError], Account())
