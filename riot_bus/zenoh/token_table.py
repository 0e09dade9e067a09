"""Table of the existing liveliness tokens, for all their followers through a port."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from riot_bus.zenoh.convert import is_delete
from riot_bus.zenoh.session_config import ANSWER_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.zenoh import api as zenoh


class TokenTable:
    """The liveliness tokens of a key expression, subscribed to once for as long as the session is open.

    Zenoh 1.10.2 notifies a client's first subscriber on the thread that reads the link, so all existing tokens have
    been received when a query that was sent afterwards ends. For tokens that the session knows already, this does not
    hold: a task notifies a second subscriber at any time, and a query may end before, or without, its answers. So there
    is no second subscriber, and the answers are ignored.

    Args:
        session: A client; nothing else in it has subscribed to these tokens.
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
        liveliness.get(expression, unread, timeout=ANSWER_S)
        ended.wait(2 * ANSWER_S)

    def follow(self, take: Callable[[str, bool], None]) -> ExitStack:
        """Report the existing tokens, and from then on each change, until the result is closed.

        Args:
            take: Called with a token and whether it exists; one call at a time.
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
        token, there = str(sample.key_expr), not is_delete(sample)
        with self._lock:
            if there == (token in self._present):
                return  # Zenoh may notify twice
            if there:
                self._present[token] = None
            else:
                del self._present[token]
            for take in list(self._followers):
                take(token, there)
