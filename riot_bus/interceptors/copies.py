"""Interceptors that make more messages: duplicates, and copies under another key."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar

from riot_bus.interceptors.timing import check_seconds
from riot_bus.pipeline.event import Event
from riot_bus.types.serve import part_of
from riot_bus.vocabulary.errors import ConfigError, PayloadError

_PUBLISHED = "write a key that ends otherwise, such as copy/{key}/seen"


@dataclass
class Duplicate:
    """Deliver messages more than once.

    Args:
        copies: Number of further copies.
        spacing: Seconds between two copies.
    """

    name: ClassVar[str] = "duplicate"
    copies: int = 1
    spacing: float = 0.0

    def __post_init__(self) -> None:
        if self.copies < 1:
            raise ConfigError(f"copies = {self.copies} is below 1")
        check_seconds("spacing", self.spacing)

    def message(self, event: Event) -> None:
        """Copy it."""
        if not self.spacing:
            event.duplicate(self.copies)
            return
        for number in range(1, self.copies + 1):
            event.add(event.message, seconds=event.delay_ns / 1e9 + self.spacing * number)


@dataclass
class Tee:
    """Publish a copy under another key as well.

    Copies are only published: under the key of a request, a copy would call the service, and under that of a reply, it
    would answer a caller. Such a key is refused at once if it is always one, otherwise as an error of the message.

    Args:
        key: Of the copy; `{key}` and `{topic}` stand for those of the message, such as `copy/{key}`.
    """

    name: ClassVar[str] = "tee"
    key: str

    def __post_init__(self) -> None:
        for found in re.findall(r"\{(.*?)\}", self.key):
            if found not in ("key", "topic"):
                raise ConfigError(f"{{{found}}} in {self.key!r} stands for nothing", hint="write {key} or {topic}")
        chunks = self.key.replace("{key}", "k").replace("{topic}", "t").split("/")
        if any(not chunk or set(chunk) & set("*$?#") for chunk in chunks):
            hint = "write it without wildcards, such as copy/{key}"
            raise ConfigError(f"{self.key!r} is not a key", hint=hint)
        if part_of(self.key) is not None:
            raise ConfigError(_no_call(self.key), hint=_PUBLISHED)

    def message(self, event: Event) -> None:
        """Copy it."""
        own = {"{key}": event.key, "{topic}": event.topic.strip("/")}
        key = re.sub(r"\{(?:key|topic)\}", lambda found: own[found.group()], self.key)
        if part_of(key) is not None:
            raise PayloadError(_no_call(key), where=event.key, hint=_PUBLISHED)
        event.add(event.message.with_(key=key), seconds=event.delay_ns / 1e9)


def _no_call(key: str) -> str:
    return f"a copy under {key!r} would be a call of a service, or an answer, instead of a message"
