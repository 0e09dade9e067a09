"""Liveliness tokens of publishers: metadata of their keys, and types that only the publishers know."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from riot_bus.types.capabilities import MOST_TOKENS
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release, wait_until
from riot_bus.zenoh.session_config import ANSWER_S
from riot_bus.zenoh.type_learner import Learner

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import zenoh

    from riot_bus.types.registry import TypeRegistry


class Announcements:
    """The present tokens of one network, or of joined segments; thread-safe.

    Args:
        wanted: Function that tells whether messages of a key are used here, so that its type is needed.
        learnt: Function called with a key whose type was learnt from its users; on a thread that may block.
    """

    def __init__(self, registry: TypeRegistry, *, wanted: Callable[[str], bool], learnt: Callable[[str], None]) -> None:
        self._registry = registry
        self._lock = threading.Lock()
        self._tokens: set[str] = set()
        self._listeners: list[Any] = []
        self._learner = Learner(registry, tokens=self._present, wanted=wanted, learnt=learnt)

    def __bool__(self) -> bool:
        return bool(self._tokens)

    def watch(self, session: zenoh.Session, *, wait: bool = True) -> None:
        """Track present and future tokens.

        Args:
            session: Session of the network; with `wait`, a client that has not received these tokens otherwise.
            wait: Whether to return only when present tokens are known and their owners have been asked for unknown
                types; with owners that do not answer, this takes two seconds.
        """
        liveliness = session.liveliness()
        self._learner.sessions.append(session)
        # On the thread that reads the link, so that a query ends after all earlier tokens have been received. Its
        # replies are ignored: zenoh 1.10.2 may leave some out, and others may be outdated.
        heard: Any = library_of(session).handlers.Callback(self._take, indirect=False)
        for adapter in self._registry.metadata_adapters():
            self._listeners.append(liveliness.declare_subscriber(adapter.tokens, heard, history=True))
            for _ in liveliness.get(adapter.tokens, timeout=ANSWER_S) if wait else ():
                pass
        if wait:
            wait_until(self._learner.idle, ANSWER_S, interval=0.01)  # a look goes over all keys whose types are sought

    def close(self) -> None:
        """End the subscriptions; safe to call twice."""
        listeners, self._listeners = self._listeners, []
        release(*listeners)
        self._learner.close()

    def details(self, key: str) -> Mapping[str, str]:
        """Return metadata for a key's channel in a log."""
        adapter = self._registry.metadata_adapter(key)
        if adapter is None:
            return {}
        return adapter.details(key, self._present())

    def _present(self) -> list[str]:
        with self._lock:
            return list(self._tokens)

    def _take(self, sample: zenoh.Sample) -> None:
        kind: Any = sample.kind
        token, gone = str(sample.key_expr), int(kind) != 0
        found = self._registry.announcement(token)  # which may tell a key's type
        with self._lock:
            if gone:
                self._tokens.discard(token)
            elif len(self._tokens) < MOST_TOKENS:
                self._tokens.add(token)
        if found is not None and found.role == "publishes" and not gone:
            self._learner.look(found.key)
