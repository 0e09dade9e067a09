"""A test bench for interceptors, and conformance tests for their authors to inherit.

    class TestMine(InterceptorConformance):
        def make(self):
            return Mine(every=3)

Needs pytest: the extra `testing`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any, Self

from riot_bus.pipeline.runner import Emission, Pipeline, Result
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from riot_bus_testkit.plugin import ODD_PAYLOADS, PluginConformance

START = 1_700_000_000_000_000_000
"""Time zero of a bench, in nanoseconds since the epoch."""


class InterceptorBench:
    """Feeds messages to interceptors, without a bus; a context manager.

    Args:
        interceptors: Interceptors, called in this order.

    Example:
        >>> from riot_bus.interceptors.losses import Drop
        >>> with InterceptorBench(Drop(every=2)) as bench:
        ...     _ = bench.feed_all([0.0, 0.1, 0.2, 0.3])
        ...     bench.times()
        [0.0, 0.2]
    """

    def __init__(self, *interceptors: object) -> None:
        self.pipeline = Pipeline(interceptors, registry=TypeRegistry(), start=START)
        self.delivered: list[Emission] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.pipeline.close()

    def feed(
        self, seconds: float = 0.0, payload: bytes | Mapping[str, Any] = b'{"x": 1.5}', key: str = "a", **more: Any
    ) -> Result:
        """Feed one message; return the result.

        Args:
            seconds: Time of the message since `START`, in seconds.
            payload: Bytes, or an object that is sent as JSON.
            key: Key of the message.
            more: Further attributes of the message.
        """
        data = payload if isinstance(payload, bytes) else json.dumps(payload).encode()
        result = self.pipeline.feed(Message(START + round(seconds * 1e9), key, data, **more))
        self.delivered += result.emissions
        return result

    def feed_all(self, times: Iterable[float], **more: Any) -> list[Result]:
        """Feed a message at each of these times, in seconds; see `feed`."""
        return [self.feed(seconds, **more) for seconds in times]

    def times(self) -> list[float]:
        """Return the delivery times since `START` in seconds, in order of arrival."""
        return [(emission.due - START) / 1e9 for emission in self.delivered]

    def payloads(self) -> list[bytes]:
        """Return the delivered payloads, in order of arrival."""
        return [emission.message.payload for emission in self.delivered]

    @property
    def errors(self) -> list[str]:
        """Errors of interceptors except PayloadError, since a message without a field is not their mistake."""
        texts = (each.first for each in self.pipeline.errors.values())
        return [text for text in texts if "errors.PayloadError: " not in text]


class InterceptorConformance(PluginConformance):
    """Tests of an interceptor: it survives any message, loses none uncounted, and is deterministic."""

    def make(self) -> object:
        """Return a new interceptor with options of your choice."""
        raise NotImplementedError

    def usual(self) -> list[tuple[int, bytes]]:
        """Return when what is delivered of numbered messages."""
        return delivered_of(self.make())

    def strange(self) -> list[str]:
        """Feed odd payloads and deletions; if it raises PayloadError, that message skips it."""
        with InterceptorBench(self.make()) as bench:
            for number, payload in enumerate(ODD_PAYLOADS):
                bench.feed(number * 0.01, payload, key=f"k{number % 2}")
                bench.feed(number * 0.01, b"", key="gone", kind="delete")
            return bench.errors

    def test_every_message_is_accounted_for(self) -> None:
        """Delivered = seen - dropped + copies + added, by topic."""
        with InterceptorBench(self.make()) as bench:
            bench.feed_all([number * 0.01 for number in range(200)])
            for topic, counts in bench.pipeline.counts.items():
                assert counts.delivered == counts.seen - counts.dropped + counts.copies + counts.added, topic

    def test_nothing_is_delivered_before_it_comes(self) -> None:
        """Messages may be late, never early."""
        with InterceptorBench(self.make()) as bench:
            for number in range(100):
                result = bench.feed(number * 0.01)
                assert all(emission.due >= START + number * 10_000_000 for emission in result.emissions)


def delivered_of(interceptor: object) -> list[tuple[int, bytes]]:
    """Return when what is delivered of 200 messages of the key `a`, at 100 Hz, with their number as `x`."""
    with InterceptorBench(interceptor) as bench:
        for number in range(200):
            bench.feed(number * 0.01, {"x": number})
        assert not bench.errors, bench.errors
        return [(each.due, each.message.payload) for each in bench.delivered]
