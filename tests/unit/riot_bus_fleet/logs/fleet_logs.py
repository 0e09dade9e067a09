"""Logs for catalogues."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message

SECOND = 10**9
BEGIN = 1_700_000_000 * SECOND


def write(
    path: Path,
    *keys: str,
    seconds: float = 10.0,
    count: int = 11,
    begin: int = BEGIN,
    size: int = 10,
    types: Mapping[str, str] | None = None,
    **metadata: str,
) -> Path:
    """A log of riot_bus: `count` messages on each key, evenly over `seconds`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    registry = TypeRegistry(declared=dict(types or {}))
    with LogWriter(path, metadata=metadata, registry=registry) as writer:
        for number in range(count):
            time = begin + int(number * seconds * SECOND / max(1, count - 1))
            for key in keys:
                writer.write(Message(time, key, b'{"v": %d}' % number + b" " * size, sequence=number))
    return path
