"""Logs to play, and who listens."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from riot_bus.log.writer import LogWriter
from riot_bus.play.options import PlayOptions
from riot_bus.play.service import PlayResult, PlayService
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.client import Client, open_client

MS = 10**6
SECOND = 10**9
BEGIN = 1_700_000_000 * SECOND


def write(path: Path, messages: Iterable[Message]) -> Path:
    """A log of riot_bus."""
    with LogWriter(path) as writer:
        for message in messages:
            writer.write(message)
    return path


def numbered(count: int, *keys: str, period: int = MS, begin: int = BEGIN) -> list[Message]:
    """Messages `{"v": 0}`, `{"v": 1}` ... over the keys in turn; of each time as many as there are keys."""
    return [
        Message(begin + number // len(keys) * period, keys[number % len(keys)], b'{"v": %d}' % number, sequence=number)
        for number in range(count)
    ]


class Listener:
    """What arrives, in its order."""

    def __init__(self, endpoint: str, *keys: str) -> None:
        self.client: Client = open_client(endpoint)
        self.messages: list[Message] = []
        self._bell = threading.Condition()
        for key in keys:
            self.client.subscribe(key, self._take)

    def _take(self, message: Message) -> None:
        with self._bell:
            self.messages.append(message)
            self._bell.notify_all()

    def wait(self, count: int, timeout: float = 60) -> list[Message]:
        """Return what has come, at least so many unless the time is up."""
        with self._bell:
            self._bell.wait_for(lambda: len(self.messages) >= count, timeout)
            return list(self.messages)

    def payloads(self, count: int) -> list[bytes]:
        return [message.payload for message in self.wait(count)]

    def clear(self) -> None:
        with self._bell:
            self.messages.clear()

    def __enter__(self) -> Listener:
        return self

    def __exit__(self, *error: object) -> None:
        self.client.close()


def play(endpoint: str, *logs: Path, warn: Callable[[str], None] | None = None, **options: Any) -> PlayResult:
    """Play to the end."""
    wanted = PlayOptions(logs=logs, endpoint=endpoint, **{"wait": 20.0, **options})
    with PlayService(wanted, warn=warn or _no_warning) as service:
        assert service.wait(60)
        return service.result()


def _no_warning(line: str) -> None:
    raise AssertionError(line)
