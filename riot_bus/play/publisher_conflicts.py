"""Detection of others that already publish the topics to play: subscribers would get both."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from riot_bus.graph.tokens import expressions, parse_token
from riot_bus.zenoh.session import release

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from riot_bus.types.registry import TypeRegistry
    from riot_bus.zenoh import api as zenoh

_LISTEN_S = 1.0  # finds publishers without a token that send at least once a second


class PublisherConflicts:
    """Search for other publishers, by their liveliness tokens and, for one second, by their messages."""

    def __init__(
        self,
        session: zenoh.Session,
        keys: Collection[str],
        registry: TypeRegistry,
        found: Callable[[str, str], None],
    ) -> None:
        self._session, self._keys, self._registry, self._found = session, keys, registry, found
        self._zid = str(session.info.zid())
        self._known: set[str] = set()
        self._lock = threading.Lock()
        self._subscribers: list[Any] = []
        self._timer = threading.Timer(_LISTEN_S, self.close)
        self._timer.daemon = True

    def look(self) -> None:
        """Ask for tokens and begin to listen."""
        from riot_bus.zenoh import api as zenoh

        for expression in expressions(self._registry):
            for reply in self._session.liveliness().get(expression, timeout=_LISTEN_S):
                if reply.ok is not None:
                    self._token(str(reply.ok.key_expr))
        for key in self._keys:
            subscriber = self._session.declare_subscriber(
                key,
                lambda sample: self._add(str(sample.key_expr), "another publisher"),
                allowed_origin=zenoh.Locality.REMOTE,
            )
            self._subscribers.append(subscriber)
        self._timer.start()

    def close(self) -> None:
        """Stop listening; safe to call twice, from any thread."""
        self._timer.cancel()
        with self._lock:
            subscribers, self._subscribers = self._subscribers, []
        release(*subscribers)

    def _token(self, text: str) -> None:
        token = parse_token(text, self._registry)
        if token is not None and token.role == "publishes" and token.zid != self._zid and token.key in self._keys:
            self._add(token.key, token.node or f"session {token.zid}")

    def _add(self, key: str, who: str) -> None:
        with self._lock:
            if key in self._known:
                return
            self._known.add(key)
        self._found(key, who)
