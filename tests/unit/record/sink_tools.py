"""Sinks of a recording without a network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from riot_bus.record.naming import Naming
from riot_bus.record.options import CaptureOptions
from riot_bus.record.recording_sink import RecordingSink
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message


def common(said: list[str], **options: Any) -> dict[str, Any]:
    """The arguments that all sinks take."""
    chosen = CaptureOptions(durable=False, **options)
    return {
        "options": chosen,
        "registry": TypeRegistry(),
        "naming": Naming(chosen),
        "metadata": lambda: {"robot": "r"},
        "details": lambda key: {},
        "profile": "",
        "warn": said.append,
    }


def put(sink: RecordingSink, *numbers: int, key: str = "a/x") -> None:
    """Record messages, as a subscriber does."""
    with sink.lock:
        track = sink.writer.track(Message(1, key, b""))
        assert track is not None
        sink.counts.recorded.add(key, len(numbers))
        sink.append([(track.number, n, n, n, bytes([n]), None) for n in numbers], patient=True)


def numbers(path: Path) -> list[int]:
    """The numbers of the messages in a file."""
    from riot_bus.log.reader import read_log

    return [message.sequence for message in read_log(path)]
