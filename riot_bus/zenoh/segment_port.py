"""A segment in terms of bytes, for bridges: an adapter knows keys, attachments and tokens, and nothing of Zenoh."""

from __future__ import annotations

import contextlib
import logging
import threading
from typing import TYPE_CHECKING, Any, Self

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.redaction import redacted
from riot_bus.zenoh.convert import is_delete
from riot_bus.zenoh.keyexpr_pins import begin_pinning, end_pinning, pin
from riot_bus.zenoh.session import open_session, prepare_runtime, release
from riot_bus.zenoh.session_config import client_config
from riot_bus.zenoh.token_table import TokenTable

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.types.port import Closeable, Take
    from riot_bus.zenoh import api as zenoh

_LOG = logging.getLogger(__name__)
_AT_ONCE = 64  # saves calls in a burst; the first ones of larger batches would wait
_CHANNEL = 4096  # messages
_HEARTBEAT_S = 0.5  # as in rmw_zenoh: SAMPLE_MISS_DETECTION_HEARTBEAT_PERIOD of rmw_publisher_data.cpp
_PATIENCE_S = 24 * 3600.0  # rmw_zenoh waits for ever


class Outlet:
    """Publisher for one key; see `SegmentPort.publisher`."""

    def __init__(self, publisher: Any, put: Any, declared: Sequence[Any]) -> None:
        self._publisher, self._put, self._declared = publisher, put, declared

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Publish; waits for slow receivers if it is reliable."""
        self._put(payload, attachment=attachment)

    def matched(self) -> bool:
        """Return whether there is a subscriber elsewhere."""
        return bool(self._publisher.matching_status.matching)

    def close(self) -> None:
        """Undeclare the publisher."""
        release(*self._declared)


class Inlet:
    """A declaration that can be undeclared."""

    def __init__(self, declared: Any) -> None:
        self._declared = declared

    def close(self) -> None:
        """Undeclare it."""
        release(self._declared)


class Collector:
    """A subscription that delivers messages on one thread of its own; see `SegmentPort.collect`."""

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


class Asked:
    """A query that was sent; see `SegmentPort.ask`."""

    def __init__(self, done: Callable[[bytes | None], None]) -> None:
        from riot_bus.zenoh import api as zenoh

        self.token: Any = zenoh.CancellationToken()
        self._done: Callable[[bytes | None], None] | None = done

    def end(self, answer: bytes | None) -> None:
        """Pass on the first answer."""
        done, self._done = self._done, None  # Zenoh calls one at a time
        if done is not None:
            done(answer)

    def close(self) -> None:
        """Give up; safe to call twice."""
        self._done = None
        self.token.cancel()


class SegmentPort:
    """A client of a segment; a context manager that disconnects at its end.

    Messages that are published through a port do not come back through it.

    Args:
        session: Session, owned by the port from now on.
    """

    def __init__(self, session: zenoh.Session, endpoint: str) -> None:
        self._session = session
        self.endpoint = redacted(endpoint)
        self.zid = str(session.info.zid())
        self._tokens: dict[str, TokenTable] = {}
        self._watching = threading.Lock()
        begin_pinning(session)

    def publisher(
        self,
        key: str,
        *,
        reliable: bool,
        latched: int | None = None,
        changed: Callable[[], None] | None = None,
        encoding: str = "",
    ) -> Outlet:
        """Return a new publisher.

        Args:
            key: Key that it publishes on.
            reliable: Whether to wait for slow receivers instead of losing messages.
            latched: Number of last messages that late joiners get; None if they get none.
            changed: Called on a Zenoh thread when `matched` may have changed.
            encoding: Zenoh's encoding string, empty for its default.
        """
        from riot_bus.zenoh import api as zenoh
        from riot_bus.zenoh.api import ext

        settings: dict[str, Any] = {
            "congestion_control": zenoh.CongestionControl.BLOCK if reliable else zenoh.CongestionControl.DROP,
            "reliability": zenoh.Reliability.RELIABLE if reliable else zenoh.Reliability.BEST_EFFORT,
            "allowed_destination": zenoh.Locality.REMOTE,
        }
        if encoding:
            settings["encoding"] = zenoh.Encoding(encoding)
        pin(self._session, key)
        publisher: Any = self._session.declare_publisher(key, **settings)
        if changed is not None:
            handler: Any = zenoh.handlers.Callback(lambda status: changed(), indirect=False)  # else each has a thread
            declared = [publisher.declare_matching_listener(handler), publisher]
        else:
            declared = [publisher]
        if latched is None:
            return Outlet(publisher, publisher.put, declared)
        beats = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=_HEARTBEAT_S)
        latch: Any = ext.declare_advanced_publisher(
            self._session,
            key,
            cache=ext.CacheConfig(latched),
            sample_miss_detection=beats if reliable else None,
            publisher_detection=True,
            **settings,
        )
        return Outlet(publisher, latch.put, [*declared, latch])

    def put_all(self, outlets: Sequence[Any], payloads: Sequence[bytes], attachment: bytes) -> int:
        """Publish many messages with one attachment; return how many could not be published."""
        return put_one_by_one(outlets, payloads, attachment)

    def subscribe(self, key: str, take: Callable[[bytes, bytes | None], None], *, latched: int | None = None) -> Inlet:
        """Subscribe to messages of others.

        Args:
            key: Key expression of the messages.
            take: Called with payload and attachment on a Zenoh thread; while it waits, so does the link.
            latched: Number of last messages to fetch from publishers that keep them; None for none.
        """
        from riot_bus.zenoh import api as zenoh
        from riot_bus.zenoh.api import ext

        def receive(sample: zenoh.Sample) -> None:
            if not is_delete(sample):
                take(*message_of(sample))

        handler: Any = zenoh.handlers.Callback(receive, indirect=False)
        pin(self._session, key)
        if latched is None:
            return Inlet(self._session.declare_subscriber(key, handler, allowed_origin=zenoh.Locality.REMOTE))
        return Inlet(
            ext.declare_advanced_subscriber(
                self._session,
                key,
                handler,
                allowed_origin=zenoh.Locality.REMOTE,
                history=ext.HistoryConfig(detect_late_publishers=True, max_samples=latched),
                recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                subscriber_detection=True,
            )
        )

    def collect(self, expression: str, take: Take) -> Collector:
        """Subscribe to messages of others; for many small messages, this takes half the time of `subscribe`.

        Args:
            expression: Key expression of the messages.
            take: Called with the messages received, always on the same thread, not one of Zenoh; while it is busy,
                messages wait, and when many wait, so does the link.
        """
        return Collector(self._session, expression, take)

    def announce(self, token: str) -> Inlet:
        """Declare a liveliness token."""
        return Inlet(self._session.liveliness().declare_token(token))

    def watch(self, expression: str, take: Callable[[str, bool], None]) -> Closeable:
        """Follow the liveliness tokens of a key expression, our own among them.

        Args:
            expression: Key expression of the tokens; those watched through one port must be equal or disjoint.
            take: Called with a token and whether it exists, once per change: for existing tokens before this returns,
                for others on a Zenoh thread; must not wait.
        """
        with self._watching:
            if expression not in self._tokens:
                self._tokens[expression] = TokenTable(self._session, expression)
        return self._tokens[expression].follow(take)

    def serve(self, key: str, take: Callable[[Question], None]) -> Inlet:
        """Answer the queries of others.

        Args:
            key: Key expression of the queries.
            take: Called with each query on a Zenoh thread; may answer later.
        """
        from riot_bus.zenoh import api as zenoh

        handler: Any = zenoh.handlers.Callback(lambda query: take(Question(key, query)), indirect=False)
        pin(self._session, key)
        return Inlet(self._session.declare_queryable(key, handler, complete=True, allowed_origin=zenoh.Locality.REMOTE))

    def ask(
        self,
        key: str,
        payload: bytes,
        attachment: bytes,
        done: Callable[[bytes | None], None],
        *,
        complete: bool = True,
    ) -> Asked:
        """Send a query to the servers of a key.

        Args:
            key: Key of the servers.
            payload: Payload of the query.
            attachment: Attachment of the query.
            done: Called once, on a Zenoh thread: with the first answer as soon as it arrives, or with None when it is
                certain that there is none. Not called after `close`, unless the call has already begun.
            complete: Whether to ask complete servers alone, as clients of rmw_zenoh do; else the nearest one.

        Returns:
            The pending query, which `close` cancels.
        """
        from riot_bus.zenoh import api as zenoh

        asked = Asked(done)

        def take(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                asked.end(reply.ok.payload.to_bytes())

        handler: Any = zenoh.handlers.Callback(take, drop=lambda: asked.end(None), indirect=False)
        self._session.get(
            key,
            handler,
            target=zenoh.QueryTarget.ALL_COMPLETE if complete else zenoh.QueryTarget.BEST_MATCHING,
            consolidation=zenoh.ConsolidationMode.NONE,
            payload=payload,
            attachment=attachment,
            timeout=_PATIENCE_S,
            allowed_destination=zenoh.Locality.REMOTE,
            cancellation_token=asked.token,
        )
        return asked

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        release(self._session)
        end_pinning(self._session)


def open_port(endpoints: Sequence[str], *, config: Mapping[str, Any] | None = None) -> SegmentPort:
    """Connect to a segment.

    Args:
        endpoints: Endpoints of the segment; the first that answers is used.
        config: Further Zenoh configuration.

    Raises:
        ConfigError: Zenoh refuses the configuration.
        EnvironmentFaultError: No endpoint answers.
    """
    prepare_runtime()
    extra = {"timestamping/enabled": True, **(config or {})}
    failure: EnvironmentFaultError | None = None
    for endpoint in endpoints:
        try:
            return SegmentPort(open_session(client_config(endpoint, extra=extra), purpose="bridge"), endpoint)
        except EnvironmentFaultError as error:
            failure = failure or error
    raise failure or EnvironmentFaultError("the segment has no endpoint", where="bridge")


def put_one_by_one(outlets: Sequence[Any], payloads: Sequence[bytes], attachment: bytes) -> int:
    """Publish messages, each with its publisher and all with one attachment; return how many could not be published."""
    failed = 0
    for outlet, payload in zip(outlets, payloads, strict=True):
        try:
            outlet.put(payload, attachment)
        except Exception:  # the segment is gone
            failed += 1
    return failed


def message_of(sample: zenoh.Sample) -> tuple[bytes, bytes | None]:
    """Return payload and attachment."""
    attachment = sample.attachment
    return sample.payload.to_bytes(), None if attachment is None else attachment.to_bytes()
