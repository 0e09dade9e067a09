"""Histories for clients that query them by the id of a publisher's session, which they know from elsewhere.

An advanced subscriber queries all caches of a key, or those that show a token, which in other segments are our own. A
few clients know the publisher's session from other announcements instead (zenoh-ros2-sdk: from ROS 2 tokens) and query
`KEY/@adv/pub/ZID/**`. They get what the proxy keeps. These answers have no numbers, since Python cannot set any; that
is why no other queries are answered.
"""

from __future__ import annotations

import time
from collections import deque
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from riot_bus.router.advanced.source import announced
from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release
from riot_bus.zenoh.session_config import ANSWER_S

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus.router.advanced.publisher_state import PublisherState
    from riot_bus.router.advanced.source import AdvancedSource
    from riot_bus.router.worker import Worker
    from riot_bus.zenoh import api as zenoh

_PATIENCE_S = 1.0  # a history takes little more than the 0.25 s of `history_mirror._UNDER_WAY_S`
_AGAIN_S = 0.01  # a look compares a few flags: at most a hundred looks within `_PATIENCE_S`


class Answers:
    """Answers to such queries in every segment.

    Args:
        find: Function that returns the states of a session's publishers, by key and id of the session.
    """

    def __init__(
        self, sessions: Mapping[str, zenoh.Session], worker: Worker, find: Callable[[str, str], list[PublisherState]]
    ) -> None:
        self._sessions, self._worker, self._find = sessions, worker, find
        self._declared: dict[str, list[Any]] = {}

    def begin(self, key: str) -> None:
        """Answer for the publishers of a key, unless that is done already; called by the worker.

        This must not begin before there is a publisher: every query for the history of a key comes here as well, and
        ends no sooner than we say. A subscriber whose first query ends late, while it queries again because of a token,
        loses the first samples. For the same reason, queries are not handled on a thread of their own.
        """
        if key in self._declared:
            return
        declared = self._declared[key] = []
        text = f"{key}/@adv/pub/**"
        for name, session in self._sessions.items():
            zenoh = library_of(session)
            pin(session, text)
            take = zenoh.handlers.Callback(partial(self._take, name), indirect=False)
            declared.append(session.declare_queryable(text, take, allowed_origin=zenoh.Locality.REMOTE))

    def end(self, key: str) -> None:
        """Stop answering for a key; called by the worker."""
        release(*self._declared.pop(key, ()))

    def _take(self, segment: str, query: Any) -> None:
        asked = announced(segment, str(query.key_expr))
        if asked is not None and asked.entity in ("*", "**") and self._find(asked.key, asked.zid):
            self._worker.do(partial(self._answer, asked, query, time.monotonic() + _PATIENCE_S))
        else:
            query.drop()

    def _answer(self, asked: AdvancedSource, query: Any, deadline: float) -> None:
        states = [state for state in self._find(asked.key, asked.zid) if state.source.segment != asked.segment]
        if all(state.opened for state in states) or time.monotonic() >= deadline:
            caches = [state.outlets[asked.segment].cache for state in states if asked.segment in state.outlets]
            self._ask(asked.segment, query, deque(caches))
        else:  # clients that query in this way do so only once
            again = partial(self._answer, asked, query, deadline)
            self._worker.later(_AGAIN_S, again, background=True)

    def _ask(self, segment: str, query: Any, caches: deque[str]) -> None:
        """Pass on what one cache has, then query the next one; without waiting, which would delay other queries."""
        if not caches:
            query.drop()
            return

        def take(reply: Any) -> None:
            if reply.ok is not None:
                _pass_on(query, reply.ok)

        session = self._sessions[segment]
        zenoh = library_of(session)
        session.get(
            f"{caches.popleft()}?{query.parameters}",
            zenoh.handlers.Callback(take, drop=partial(self._ask, segment, query, caches), indirect=False),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            allowed_destination=zenoh.Locality.SESSION_LOCAL,
            timeout=ANSWER_S,
        )


def _pass_on(query: Any, sample: Any) -> None:
    with suppress(library_of(query).ZError):  # a query that accepts answers only on its own key gets none from caches
        query.reply(
            sample.key_expr,
            sample.payload,
            encoding=sample.encoding,
            attachment=sample.attachment,
            timestamp=sample.timestamp,
        )
