"""What interceptors remember of each topic, in bounded memory."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

from riot_bus.pipeline.runner import MOST_TOPICS

ValueT = TypeVar("ValueT")


class PerTopic(Generic[ValueT]):
    """State by topic; if there is too much of it, the state that was not set for longest is forgotten.

    Args:
        most: Largest sum of the sizes.
        size: Function that returns the size of a state; by default each counts as one.
    """

    def __init__(self, *, most: int = MOST_TOPICS, size: Callable[[ValueT], int] | None = None) -> None:
        self._states: OrderedDict[str, ValueT] = OrderedDict()
        self._most, self._size = most, size
        self._sum = 0

    def __len__(self) -> int:
        return len(self._states)

    def get(self, topic: str) -> ValueT | None:
        """Return a topic's state, None if there is none."""
        return self._states.get(topic)

    def __setitem__(self, topic: str, value: ValueT) -> None:
        former = self._states.get(topic)
        if former is not None:
            self._sum -= self._size_of(former)
        self._states[topic] = value
        self._states.move_to_end(topic)
        self._sum += self._size_of(value)
        while self._sum > self._most and len(self._states) > 1:
            _, oldest = self._states.popitem(last=False)
            self._sum -= self._size_of(oldest)

    def _size_of(self, value: ValueT) -> int:
        return 1 if self._size is None else self._size(value)
