"""Keeps which liveliness tokens are there, for all who follow them through a port."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.zenoh import api as zenoh

__all__ = ["TokenTable"]

_ANSWER_S = 2.0


class TokenTable:
    """The liveliness tokens of a key expression, subscribed to once for as long as the session is open.

    Zenoh 1.10.2 tells a client's first subscriber on the thread that reads the link, so all tokens that were there have
    been heard when a query that was sent after it ends. For what the session knows already neither holds: a second
    subscriber is told by a task that runs whenever it does, and a query may end before, or without, its answers. So
    there is no second subscriber, and nobody looks at the answers.

    Args:
        session: A client; nothing else in it has subscribed to these tokens.
        expression: Key expression of the tokens.
    """

    def __init__(self, session: zenoh.Session, expression: str) -> None:
        from riot_bus.zenoh import api as zenoh

        self._lock = threading.RLock()
        self._present: dict[str, None] = {}
        self._followers: list[Callable[[str, bool], None]] = []
        ended, liveliness = threading.Event(), session.liveliness()
        heard: Any = zenoh.handlers.Callback(self._hear, indirect=False)
        self._subscriber = liveliness.declare_subscriber(expression, heard, history=True)
        unread: Any = zenoh.handlers.Callback(lambda reply: None, drop=ended.set, indirect=False)
        liveliness.get(expression, unread, timeout=_ANSWER_S)
        ended.wait(2 * _ANSWER_S)

    def follow(self, take: Callable[[str, bool], None]) -> ExitStack:
        """Tell which tokens are there, and from then on each change, until the result is closed.

        Args:
            take: Called with a token and whether it is there; once at a time.
        """
        following = ExitStack()
        following.callback(self._leave, take)
        with self._lock:
            self._followers.append(take)
            for token in list(self._present):
                take(token, True)  # noqa: FBT003
        return following

    def _leave(self, take: Callable[[str, bool], None]) -> None:
        with self._lock:
            self._followers.remove(take)

    def _hear(self, sample: zenoh.Sample) -> None:
        kind: Any = sample.kind
        token, there = str(sample.key_expr), int(kind) == 0
        with self._lock:
            if there == (token in self._present):
                return  # Zenoh may tell twice
            if there:
                self._present[token] = None
            else:
                del self._present[token]
            for take in list(self._followers):
                take(token, there)
