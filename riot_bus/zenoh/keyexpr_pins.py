"""Numbers that a session has given to keys, and does not take back while it goes on.

A session gives each key on which it declares something a number, and takes it back with the last of these declarations.
Zenoh 1.10.2 throws away what is on its way to the session under that number just then: a message is lost, a question is
not even ended. So a session that receives while it declares and undeclares holds these keys for a while.

Keys of which it receives much get a number, too, though nothing is declared on them: under a number they come faster.
"""

from __future__ import annotations

import itertools
import threading
from collections import OrderedDict
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from riot_bus.zenoh.libraries import library_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    import zenoh

__all__ = ["FrequentKeys", "begin_pinning", "end_pinning", "no_more_numbers", "pin"]

_MOST = 1 << 14
_MOST_FREQUENT = 1 << 12
_OFTEN = 8
_held: dict[int, OrderedDict[str, zenoh.KeyExpr]] = {}
_frequent: dict[int, dict[str, zenoh.KeyExpr]] = {}
_numbering = threading.Lock()


def begin_pinning(session: zenoh.Session) -> None:
    """Let a session hold keys, until `end_pinning`."""
    _held[id(session)] = OrderedDict()
    _frequent[id(session)] = {}


def end_pinning(session: zenoh.Session) -> None:
    """Let go what a session holds; call when it is closed. Safe to call twice."""
    _held.pop(id(session), None)
    _frequent.pop(id(session), None)


def pin(session: zenoh.Session, expression: str) -> None:
    """Keep the numbers for an expression on which something is about to be declared; of many, those used last.

    Args:
        session: Nothing is done if it does not hold keys.
        expression: Canonical key expression. Publishers and queriers give it a number as a whole, subscriptions and
            queryables its part before the first wildcard.
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


@contextmanager
def no_more_numbers() -> Iterator[None]:
    """Let no frequent key get a number meanwhile; one that just gets one has it when this begins."""
    with _numbering:
        yield


class FrequentKeys:
    """Gives numbers to keys of which a session gets many messages, though it subscribes to them with a wildcard only.

    Under such a number Zenoh knows who subscribes. For a key without one, it puts together the text with each message,
    and compares it with all subscriptions of the session: a third of what it costs to receive a small message.

    Args:
        session: Who receives; nothing is done if it does not hold keys.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._error = library_of(session).ZError
        self._seen: dict[zenoh.KeyExpr, int] = {}

    def saw(self, key: zenoh.KeyExpr) -> None:
        """Take note of a key; enough are the keys of some messages, as those that come often are among them often.

        Args:
            key: As a sample has it.
        """
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
        # None is let go to make room: messages of it may be on their way.
        if known is not None and len(known) < _MOST_FREQUENT and key not in known:
            with suppress(self._error):  # it is closed
                known[key] = self._session.declare_keyexpr(key)
