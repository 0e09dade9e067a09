"""Who announces publishers by liveliness tokens, and what that says of a key, for those who record."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from riot_bus.bus.runtime import release

if TYPE_CHECKING:
    from collections.abc import Mapping

    import zenoh

    from riot_bus.types.registry import TypeRegistry

__all__ = ["Announcements"]

_ANSWER_S = 2.0
_MOST_TOKENS = 50_000


class Announcements:
    """The present tokens of one network, or of segments that are joined; thread-safe.

    Args:
        registry: Its adapters say which tokens there are, and what they mean.
    """

    def __init__(self, registry: TypeRegistry) -> None:
        self._registry = registry
        self._lock = threading.Lock()
        self._tokens: set[str] = set()
        self._listeners: list[Any] = []

    def __bool__(self) -> bool:
        return bool(self._tokens)

    def watch(self, session: zenoh.Session, *, wait: bool = True) -> None:
        """Take in who is there, now and later.

        Args:
            session: A session of the network.
            wait: Return once present tokens are known.
        """
        liveliness = session.liveliness()
        for adapter in self._registry.stampings():
            self._listeners.append(liveliness.declare_subscriber(adapter.tokens, self._take, history=True))
            for reply in liveliness.get(adapter.tokens, timeout=_ANSWER_S) if wait else ():  # what goes now is heard
                if reply.ok is not None:
                    self._take(reply.ok)

    def close(self) -> None:
        """Listen no more; safe to call twice."""
        listeners, self._listeners = self._listeners, []
        release(*listeners)

    def details(self, key: str) -> Mapping[str, str]:
        """Return metadata for a key's channel in a log."""
        adapter = self._registry.stamping(key)
        if adapter is None:
            return {}
        with self._lock:
            tokens = list(self._tokens)
        return adapter.details(key, tokens)

    def _take(self, sample: zenoh.Sample) -> None:
        kind: Any = sample.kind
        self._registry.announcement(str(sample.key_expr))  # which may tell a key's type
        with self._lock:
            if int(kind) != 0:
                self._tokens.discard(str(sample.key_expr))
            elif len(self._tokens) < _MOST_TOKENS:
                self._tokens.add(str(sample.key_expr))
