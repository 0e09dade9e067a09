"""Numbers that a session has given to keys, and does not take back while it goes on.

A session gives each key on which it declares something a number, and takes it back with the last of these declarations.
Zenoh 1.10.2 throws away what is on its way to the session under that number just then: a message is lost, a question is
not even ended. So a session that receives while it declares and undeclares holds these keys for a while.
"""

from __future__ import annotations

import itertools
from collections import OrderedDict
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import zenoh

__all__ = ["begin_holding", "end_holding", "hold"]

_MOST = 1 << 14
_held: dict[int, OrderedDict[str, zenoh.KeyExpr]] = {}


def begin_holding(session: zenoh.Session) -> None:
    """Let a session hold keys, until `end_holding`."""
    _held[id(session)] = OrderedDict()


def end_holding(session: zenoh.Session) -> None:
    """Let go what a session holds; call when it is closed. Safe to call twice."""
    _held.pop(id(session), None)


def hold(session: zenoh.Session, expression: str) -> None:
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
