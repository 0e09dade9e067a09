"""What interceptors remember of each topic, in bounded memory."""

from __future__ import annotations

from typing import TypeVar

__all__ = ["PerTopic"]

_MOST = 1 << 16
ValueT = TypeVar("ValueT")


class PerTopic(dict[str, ValueT]):
    """State by topic; the oldest topics are forgotten when somebody invents too many."""

    def __setitem__(self, topic: str, value: ValueT) -> None:
        if topic not in self and len(self) >= _MOST:
            del self[next(iter(self))]
        super().__setitem__(topic, value)
