"""Numeric ids that a session assigns to keys, and keeps while it is open.

A session assigns a number to each key on which it declares something, and releases it with the last such declaration.
Zenoh 1.10.2 discards what is in transit to the session under that number at that moment: a message is lost, a query
does not even end. So a session that receives while it declares and undeclares holds these keys for a while.

Keys with many received messages get a number, too, even without declarations: messages under a number are faster.
"""

from __future__ import annotations

import itertools
import threading
from collections import OrderedDict
from contextlib import suppress
from typing import TYPE_CHECKING

from riot_bus.zenoh.libraries import library_of

if TYPE_CHECKING:
    import zenoh

_MOST = 1 << 14  # a quarter of Zenoh's numbers, which have 16 bits
_MOST_FREQUENT = _MOST // 4  # none is released before the session ends
_OFTEN = 8  # rare keys are not worth a declaration; a guess
_held: dict[int, OrderedDict[str, zenoh.KeyExpr]] = {}
_frequent: dict[int, dict[str, zenoh.KeyExpr]] = {}
_numbering = threading.Lock()


def begin_pinning(session: zenoh.Session) -> None:
    """Let a session hold keys, until `end_pinning`."""
    _held[id(session)] = OrderedDict()
    _frequent[id(session)] = {}


def end_pinning(session: zenoh.Session) -> None:
    """Release the keys of a session, when it is closed; safe to call twice."""
    _held.pop(id(session), None)
    _frequent.pop(id(session), None)


def pin(session: zenoh.Session, expression: str) -> None:
    """Keep the numbers of a key expression that is about to be declared; of too many, keep the most recently used.

    Args:
        session: The session; nothing is done if it does not hold keys.
        expression: Canonical key expression; publishers and queriers assign a number to all of it, subscribers and
            queryables to its part before the first wildcard.
    """
    held = _held.get(id(session))
    if held is None:
        return
    prefix = "/".join(itertools.takewhile(lambda chunk: "*" not in chunk, expression.split("/")))
    for text in {prefix, expression} - {""}:
        with suppress(KeyError):  # it is new, or another thread was first
            held.move_to_end(text)
            continue
        held[text] = session.declare_keyexpr(text)
        if len(held) > _MOST:
            with suppress(KeyError):
                held.popitem(last=False)


class FrequentKeys:
    """Assigns numbers to keys of which a session gets many messages, though it subscribes only with a wildcard.

    Under such a number, Zenoh knows the subscribers. For a key without a number, it assembles the text for each message
    and compares it with all subscriptions of the session: a third of the cost of receiving a small message.

    Args:
        session: Session that receives; nothing is done if it does not hold keys.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._error = library_of(session).ZError
        self._seen: dict[zenoh.KeyExpr, int] = {}

    def saw(self, key: zenoh.KeyExpr) -> None:
        """Count a key; a sample of all messages is enough, since frequent keys are frequent in it, too."""
        times = self._seen.get(key, 0) + 1
        if times > _OFTEN:
            return
        if len(self._seen) >= _MOST_FREQUENT and times == 1:
            self._seen.clear()
        if times < _OFTEN:
            self._seen[key] = times
        elif _numbering.acquire(blocking=False):  # else another time
            try:
                self._seen[key] = times
                self._give_number(str(key))
            finally:
                _numbering.release()

    def _give_number(self, key: str) -> None:
        known = _frequent.get(id(self._session))
        # No key is released to make room: messages under its number may be in transit.
        if known is not None and len(known) < _MOST_FREQUENT and key not in known:
            with suppress(self._error):  # it is closed
                known[key] = self._session.declare_keyexpr(key)
