"""Numbers that a router's own session has given to keys, and does not take back while it goes on.

A session gives each key that it declares something on a number, and takes it back with the last of these declarations.
Zenoh 1.10.2 throws away what is on its way to the session under that number just then: a message is lost, a question is
not even ended. So a router's session holds the keys on which it declares something for a while.
"""

from __future__ import annotations

import itertools
from collections import OrderedDict
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import zenoh

__all__ = ["begin_holding", "end_holding", "hold"]

_MOST = 1 << 13
_held: dict[int, OrderedDict[str, zenoh.KeyExpr]] = {}


def begin_holding(session: zenoh.Session) -> None:
    """Let a session hold keys."""
    _held[id(session)] = OrderedDict()


def end_holding(session: zenoh.Session) -> None:
    """Let go what a session holds; call when it is closed."""
    _held.pop(id(session), None)


def hold(session: zenoh.Session, expression: str) -> None:
    """Keep the number for an expression, on which something is about to be declared; of the oldest of many it is lost.

    Args:
        session: Nothing is done if it does not hold keys.
        expression: Canonical key expression. What has the number is its part before the first wildcard.
    """
    held = _held.get(id(session))
    prefix = "/".join(itertools.takewhile(lambda chunk: "*" not in chunk, expression.split("/")))
    if held is None or not prefix or prefix in held:
        return
    held[prefix] = session.declare_keyexpr(prefix)
    if len(held) > _MOST:
        with suppress(KeyError):  # another thread was first
            held.popitem(last=False)
