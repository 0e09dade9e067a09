"""Queries of the caches of components."""

from __future__ import annotations

import threading
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from riot_bus.router.advanced.source import source_of
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session_config import ANSWER_S

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus.router.advanced.source import AdvancedSource
    from riot_bus.router.worker import Worker
    from riot_bus.zenoh import api as zenoh

_MOST_BYTES = 1 << 28  # of the answers to a query: what a reader of logs holds at most (`LogLimits.held`)
_SAMPLE_BYTES = 1 << 10  # of an answer besides its payload, generously: its Python objects
_CHANNEL = 1 << 16  # answers until the next look; a full channel would block a thread of Zenoh's
_PAUSE_S = 0.001  # about a round trip (docs/figures.md: 0.39 ms one way); doubles with each look
_LONGEST_PAUSE_S = 0.05  # about 40 looks until a query times out; nothing waits for the answers


class CacheAnswer(NamedTuple):
    """Answer of a cache.

    Attributes:
        samples: Number and sample, the oldest first.
        complete: Whether all queried caches have answered in time, and no answer was left out for want of room.
        asked: Whether there is a cache at all.
    """

    samples: list[tuple[int, Any]]
    complete: bool
    asked: bool


class Upstream:
    """Queries without waiting: a cache that is slow, or never answers, delays only its own publisher's messages."""

    def __init__(self, sessions: Mapping[str, zenoh.Session], worker: Worker) -> None:
        self._sessions, self._worker = sessions, worker

    def ask(self, source: AdvancedSource, parameters: str, then: Callable[[CacheAnswer], None]) -> None:
        """Query one publisher's cache for all samples, or for some by parameters such as `?_sn=3..4`."""
        zenoh = library_of(self._sessions[source.segment])
        samples: list[tuple[int, Any]] = []
        failed, room = False, _MOST_BYTES
        caller = threading.get_ident()

        def take(reply: Any) -> None:
            nonlocal failed, room
            room -= 0 if reply.ok is None else len(reply.ok.payload) + _SAMPLE_BYTES
            if reply.ok is None or room < 0:
                failed = True
            elif (known := source_of(source.segment, reply.ok)) is not None:
                samples.append((known[1], reply.ok))

        def done() -> None:
            # When there is no cache, Zenoh ends the query at once, on the thread that sent it. (Matching status
            # would be the proper way, but in 1.10.2 it does not see these caches.)
            asked = threading.get_ident() != caller
            samples.sort(key=lambda each: each[0])
            self._worker.do(partial(then, CacheAnswer(samples, not failed, asked)))

        selector = f"{source.key}/@adv/pub/{source.zid}/{source.entity}/**{parameters}"
        self._get(source.segment, selector, zenoh.handlers.Callback(take, drop=done, indirect=False))

    def search(self, segment: str, selector: str, then: Callable[[AdvancedSource], None]) -> None:
        """Find the publishers that have caches.

        This happens for every new key, and nothing waits for it, so the answers are polled. A callback would slow down
        the whole segment: once a Zenoh thread has dropped one, every call into this copy of the library looks for
        Python objects to drop (pyo3 0.25), and a forwarder makes about fifteen calls for each message.
        """
        handlers = library_of(self._sessions[segment]).handlers
        channel = self._get(segment, selector, handlers.FifoChannel(_CHANNEL))
        self._worker.do(partial(self._look, segment, channel, then, _PAUSE_S))

    def _look(self, segment: str, channel: Any, then: Callable[[AdvancedSource], None], pause: float) -> None:
        try:
            while (reply := channel.try_recv()) is not None:
                known = None if reply.ok is None else source_of(segment, reply.ok)
                if known is not None:
                    then(known[0])
        except library_of(self._sessions[segment]).ZError:  # there will be no more
            return
        again = partial(self._look, segment, channel, then, min(2 * pause, _LONGEST_PAUSE_S))
        self._worker.later(pause, again, background=True)

    def _get(self, segment: str, selector: str, handler: Any) -> Any:
        session = self._sessions[segment]
        zenoh = library_of(session)
        return session.get(
            selector,
            handler,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            allowed_destination=zenoh.Locality.REMOTE,
            timeout=ANSWER_S,
        )
