"""A segment of another router, with everything that bridges use: latched topics, tokens, services, batches."""

from __future__ import annotations

import contextlib
import logging
import threading
from typing import TYPE_CHECKING, Any

from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.segment_port import Inlet, Outlet, SegmentPort, message_of, receiver, settings_of
from riot_bus.zenoh.session import release
from riot_bus.zenoh.session_config import HEARTBEAT_S

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.types.port import Take
    from riot_bus.zenoh import api as zenoh

_LOG = logging.getLogger(__name__)
_AT_ONCE = 64  # saves calls in a burst; the first ones of larger batches would wait
_CHANNEL = 4096  # messages


class Collector:
    """A subscription that delivers messages on one thread of its own; see `OuterPort.collect`."""

    def __init__(self, session: zenoh.Session, expression: str, take: Take) -> None:
        from riot_bus.zenoh import api as zenoh

        self._expression, self._take, self._zenoh_error = expression, take, zenoh.ZError
        pin(session, expression)
        self._subscriber: Any = session.declare_subscriber(
            expression, zenoh.handlers.FifoChannel(_CHANNEL), allowed_origin=zenoh.Locality.REMOTE
        )
        self._channel: Any = self._subscriber.handler
        self._thread = threading.Thread(target=self._run, name="riot-port", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the subscription, after delivering the messages received so far."""
        release(self._subscriber)
        self._thread.join()

    def _run(self) -> None:
        receive, fetch = self._channel.recv, self._channel.try_recv
        with contextlib.suppress(self._zenoh_error):  # the subscriber is closed, and nothing is left in its channel
            while True:
                samples = [receive()]
                with contextlib.suppress(self._zenoh_error):
                    while len(samples) < _AT_ONCE and (sample := fetch()) is not None:
                        samples.append(sample)
                try:
                    self._take([message_of(each) for each in samples if int(each.kind) == 0])
                except Exception:
                    _LOG.exception("messages for %s were lost", self._expression)


class Question:
    """A query to be answered once, on any thread."""

    def __init__(self, key: str, query: zenoh.Query) -> None:
        self._key, self._query = key, query
        payload, attachment = query.payload, query.attachment
        self.payload = b"" if payload is None else payload.to_bytes()
        self.attachment = None if attachment is None else attachment.to_bytes()

    def answer(self, payload: bytes, attachment: bytes | None) -> None:
        """Answer."""
        with contextlib.suppress(Exception):  # the client is gone
            self._query.reply(self._key, payload, attachment=attachment)
        self._end()

    def fail(self, reason: str) -> None:
        """Answer with an error."""
        with contextlib.suppress(Exception):  # the client is gone
            self._query.reply_err(reason)
        self._end()

    def _end(self) -> None:
        query: Any = self._query
        query.drop()


class OuterPort(SegmentPort):
    """A client of a segment, for bridges."""

    def publisher(
        self,
        key: str,
        *,
        reliable: bool,
        changed: Callable[[], None] | None = None,
        encoding: str = "",
        latched: int | None = None,
    ) -> Outlet:
        """Return a new publisher; `latched` is the number of last messages that late joiners get, None for none."""
        from riot_bus.zenoh.api import ext

        outlet = super().publisher(key, reliable=reliable, changed=changed, encoding=encoding)
        if latched is None:
            return outlet
        beats = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S)
        latch: Any = ext.declare_advanced_publisher(
            self._session,
            key,
            cache=ext.CacheConfig(latched),
            sample_miss_detection=beats if reliable else None,
            publisher_detection=True,
            **settings_of(reliable=reliable),
        )
        return Outlet(outlet.publisher, latch.put, [*outlet.declared, latch])

    def put_all(self, outlets: Sequence[Any], payloads: Sequence[bytes], attachment: bytes) -> int:
        """Publish many messages with one attachment; return how many could not be published."""
        return put_one_by_one(outlets, payloads, attachment)

    def subscribe(self, key: str, take: Callable[[bytes, bytes | None], None], *, latched: int | None = None) -> Inlet:
        """Subscribe, as `SegmentPort`; `latched` is how many last messages to fetch from those that keep them."""
        from riot_bus.zenoh import api as zenoh
        from riot_bus.zenoh.api import ext

        if latched is None:
            return super().subscribe(key, take)
        pin(self._session, key)
        return Inlet(
            ext.declare_advanced_subscriber(
                self._session,
                key,
                receiver(take),
                allowed_origin=zenoh.Locality.REMOTE,
                history=ext.HistoryConfig(detect_late_publishers=True, max_samples=latched),
                recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                subscriber_detection=True,
            )
        )

    def collect(self, expression: str, take: Take) -> Collector:
        """Subscribe to messages of others; for many small messages, this takes half the time of `subscribe`.

        Args:
            take: Called with the messages received, always on the same thread, not one of Zenoh; while it is busy,
                messages wait, and when many wait, so does the link.
        """
        return Collector(self._session, expression, take)

    def announce(self, token: str) -> Inlet:
        """Declare a liveliness token."""
        return Inlet(self._session.liveliness().declare_token(token))

    def serve(self, key: str, take: Callable[[Question], None]) -> Inlet:
        """Answer the queries of others.

        Args:
            take: Called with each query on a Zenoh thread; may answer later.
        """
        from riot_bus.zenoh import api as zenoh

        handler: Any = zenoh.handlers.Callback(lambda query: take(Question(key, query)), indirect=False)
        pin(self._session, key)
        return Inlet(self._session.declare_queryable(key, handler, complete=True, allowed_origin=zenoh.Locality.REMOTE))


def put_one_by_one(outlets: Sequence[Any], payloads: Sequence[bytes], attachment: bytes) -> int:
    """Publish messages, each with its publisher and all with one attachment; return how many could not be published."""
    failed = 0
    for outlet, payload in zip(outlets, payloads, strict=True):
        try:
            outlet.put(payload, attachment)
        except Exception:  # the segment is gone
            failed += 1
    return failed
