"""Asks those who use a key for its type, if nothing here defines it: on a thread of its own, one question at a time.

Nobody waits for the answers. A component that comes up may announce what it sends before it answers questions, so it is
asked again, a few times.
"""

from __future__ import annotations

import logging
import threading
from functools import partial
from typing import TYPE_CHECKING, Any

from riot_bus.bus.advanced.worker import Worker

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import zenoh

    from riot_bus.types.registry import TypeRegistry

__all__ = ["Learner"]

_LOG = logging.getLogger(__name__)
_FIRST_S = 0.05  # what a component announces comes in a burst
_AGAIN_S = (1.0, 5.0, 20.0, 60.0)
_ANSWER_S = 2.0
_MOST_KEYS = 1 << 14
_MOST_QUESTIONS = 10_000
_MOST_REPLIES = 4
_MOST_BYTES = 1 << 20


class Learner:
    """Learns the types of keys.

    Args:
        registry: Its adapters know what is missing, whom to ask and how.
        tokens: Returns all present liveliness tokens.
        learnt: Called with each key whose type has become known.

    Attributes:
        sessions: Where to ask, one after the other until somebody answers.
    """

    def __init__(
        self, registry: TypeRegistry, *, tokens: Callable[[], Sequence[str]], learnt: Callable[[str], None]
    ) -> None:
        self.sessions: list[zenoh.Session] = []
        self._registry, self._tokens, self._learnt = registry, tokens, learnt
        self._lock = threading.Lock()
        self._settled: set[str] = set()
        self._pending: set[str] = set()
        self._asked = 0
        self._closed = False
        self._worker: Worker | None = None
        self._cancelled: Any = None

    def look(self, key: str) -> None:
        """Learn the type of a key, soon, if it is missing; returns at once. Call it whenever the key is announced."""
        with self._lock:
            if self._closed or key in self._settled or key in self._pending or len(self._pending) >= _MOST_KEYS:
                return
            self._pending.add(key)
            if self._worker is None:
                import zenoh

                self._cancelled = zenoh.CancellationToken()
                self._worker = Worker("riot-types")
            self._worker.later(_FIRST_S, partial(self._try, key, 0))

    def idle(self) -> bool:
        """Return whether all that is missing was asked for once."""
        return self._worker is None or self._worker.idle()

    def close(self) -> None:
        """Ask no more; safe to call twice."""
        with self._lock:
            self._closed = True
        if self._worker is not None:
            self._cancelled.cancel()
            self._worker.close()

    def _try(self, key: str, number: int) -> None:
        if self._closed:
            return
        registry = self._registry
        missing = registry.missing(key)
        if missing and not registry.learn(key, self._tokens(), self._ask):
            if number < len(_AGAIN_S) and self._worker is not None:
                self._worker.later(_AGAIN_S[number], partial(self._try, key, number + 1), background=True)
            else:
                self._pending.discard(key)  # until somebody else announces it
            return
        if len(self._settled) >= _MOST_KEYS:
            self._settled.clear()
        self._settled.add(key)
        self._pending.discard(key)
        if missing:
            _LOG.info("the type of %s was told by those who use it", registry.topic(key))
            self._learnt(key)

    def _ask(self, key: str, payload: bytes, attachment: bytes) -> Iterator[bytes]:
        import zenoh

        for session in self.sessions:
            if self._closed or self._asked >= _MOST_QUESTIONS:
                return
            self._asked += 1
            try:
                replies = session.get(
                    key,
                    payload=payload,
                    attachment=attachment,
                    consolidation=zenoh.ConsolidationMode.NONE,
                    timeout=_ANSWER_S,
                    allowed_destination=zenoh.Locality.REMOTE,  # not our own stand-ins for services
                    cancellation_token=self._cancelled,
                )
            except zenoh.ZError:  # it is closed, or this is no key
                continue
            answered = False
            for _, reply in zip(range(_MOST_REPLIES), replies, strict=False):
                sample = reply.ok
                if sample is not None and len(sample.payload) <= _MOST_BYTES:
                    answered = True
                    yield sample.payload.to_bytes()
            if answered:
                return
