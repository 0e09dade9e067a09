"""A subscription whose messages are received in batches.

A full channel of Zenoh wakes its sender for each message that is taken out, and a callback takes the interpreter lock
for each message: neither keeps up with a fast sender.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

from riot_bus.zenoh.keyexpr_pins import FrequentKeys, pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release

if TYPE_CHECKING:
    import zenoh

_CHANNEL = 256  # Zenoh's default; a sender blocks when it is full
LARGEST_BATCH = _CHANNEL * 2  # what comes while one is emptied goes along; bounds a batch
_MOST_BYTES = 1 << 24  # bounds the memory of a batch, by the size of the last payload before


class Batches:
    """A subscription from its construction on, for one receiving thread."""

    def __init__(self, session: zenoh.Session, expression: str) -> None:
        zenoh = library_of(session)
        self._error = zenoh.ZError
        self._frequent = FrequentKeys(session)
        pin(session, expression)
        self._subscriber = session.declare_subscriber(expression, zenoh.handlers.FifoChannel(_CHANNEL))
        self._channel = self._subscriber.handler  # receiving through the subscriber would lock it against undeclaring
        self._most = LARGEST_BATCH
        self._closed = False

    def receive(self) -> list[Any]:
        """Wait for samples and return them; empty if this or the session is closed and all were received."""
        fetch = self._channel.try_recv
        try:
            samples = [self._channel.recv()]
        except self._error:
            return []
        with suppress(self._error):
            for _ in range(self._most):
                sample = fetch()
                if sample is None:
                    break
                samples.append(sample)
        self._frequent.saw(samples[-1].key_expr)
        self._most = min(LARGEST_BATCH, _MOST_BYTES // (len(samples[-1].payload) + 1))
        return samples

    def close(self) -> None:
        """Stop receiving; safe to call twice."""
        if not self._closed:
            self._closed = True
            release(self._subscriber)
