"""Asking the caches of components."""

from __future__ import annotations

import threading
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from riot_bus.bus.advanced.source import source_of
from riot_bus.bus.libraries import library_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import zenoh

    from riot_bus.bus.advanced.source import Source
    from riot_bus.bus.advanced.worker import Worker

__all__ = ["Found", "Upstream"]

_TIMEOUT_S = 2.0


class Found(NamedTuple):
    """What a cache answered.

    Attributes:
        samples: Publisher, number and sample, the oldest first.
        complete: Whether everybody who was asked has answered in time.
        asked: Whether there is a cache at all.
    """

    samples: list[tuple[Source, int, Any]]
    complete: bool
    asked: bool

    @property
    def numbers(self) -> list[tuple[int, Any]]:
        """Numbers and samples, when only one publisher was asked."""
        return [(number, sample) for _, number, sample in self.samples]


class Upstream:
    """Asks without waiting: a cache that is slow, or never answers, delays nothing but its own publisher's messages.

    Args:
        sessions: The segments' own sessions.
        worker: Goes on when the answers are there.
    """

    def __init__(self, sessions: Mapping[str, zenoh.Session], worker: Worker) -> None:
        self._sessions, self._worker = sessions, worker

    def ask(self, source: Source, parameters: str, then: Callable[[Found], None]) -> None:
        """Ask one publisher's cache.

        Args:
            source: The publisher.
            parameters: Which samples, such as `?_sn=3..4`; all if empty.
            then: Called by the worker.
        """
        selector = f"{source.key}/@adv/pub/{source.zid}/{source.entity}/**{parameters}"
        self.search(source.segment, selector, then)

    def search(self, segment: str, selector: str, then: Callable[[Found], None]) -> None:
        """Ask all caches of a segment that a selector means."""
        session = self._sessions[segment]
        zenoh = library_of(session)
        samples: list[tuple[Source, int, Any]] = []
        failed: list[Any] = []
        caller = threading.get_ident()

        def take(reply: Any) -> None:
            if reply.ok is None:
                failed.append(reply.err)
            elif (known := source_of(segment, reply.ok)) is not None:
                samples.append((*known, reply.ok))

        def done() -> None:
            # When there is nobody to ask, Zenoh ends the query at once, on the thread that asked. (Matching status
            # would be the proper way, but in 1.10.2 it does not see these caches.)
            asked = threading.get_ident() != caller
            samples.sort(key=lambda each: each[1])
            self._worker.do(partial(then, Found(samples, not failed, asked)))

        session.get(
            selector,
            zenoh.handlers.Callback(take, drop=done, indirect=False),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            allowed_destination=zenoh.Locality.REMOTE,
            timeout=_TIMEOUT_S,
        )
