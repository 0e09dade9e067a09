"""A segment in terms of bytes, for adapters, which know keys, attachments and tokens, and nothing of Zenoh."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any, Self, TypeVar

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.redaction import redacted
from riot_bus.zenoh.convert import is_delete
from riot_bus.zenoh.keyexpr_pins import begin_pinning, end_pinning, pin
from riot_bus.zenoh.session import open_session, prepare_runtime, release
from riot_bus.zenoh.session_config import client_config
from riot_bus.zenoh.token_table import TokenTable

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.types.port import Closeable
    from riot_bus.zenoh import api as zenoh


class Outlet:
    """Publisher for one key; see `SegmentPort.publisher`."""

    def __init__(self, publisher: Any, put: Any, declared: Sequence[Any]) -> None:
        self.publisher, self._put, self.declared = publisher, put, declared

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Publish; waits for slow receivers if it is reliable."""
        self._put(payload, attachment=attachment)

    def matched(self) -> bool:
        """Return whether there is a subscriber elsewhere."""
        return bool(self.publisher.matching_status.matching)

    def close(self) -> None:
        """Undeclare the publisher."""
        release(*self.declared)


class Inlet:
    """A declaration that can be undeclared."""

    def __init__(self, declared: Any) -> None:
        self._declared = declared

    def close(self) -> None:
        """Undeclare it."""
        release(self._declared)


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
        self, key: str, *, reliable: bool, changed: Callable[[], None] | None = None, encoding: str = ""
    ) -> Outlet:
        """Return a new publisher.

        Args:
            key: Key that it publishes on.
            reliable: Whether to wait for slow receivers instead of losing messages.
            changed: Called on a Zenoh thread when `matched` may have changed.
            encoding: Zenoh's encoding string, empty for its default.
        """
        from riot_bus.zenoh import api as zenoh

        more: dict[str, Any] = {"encoding": zenoh.Encoding(encoding)} if encoding else {}
        pin(self._session, key)
        publisher: Any = self._session.declare_publisher(key, **settings_of(reliable=reliable), **more)
        declared = [publisher]
        if changed is not None:
            handler: Any = zenoh.handlers.Callback(lambda status: changed(), indirect=False)  # else each has a thread
            declared = [publisher.declare_matching_listener(handler), publisher]
        return Outlet(publisher, publisher.put, declared)

    def subscribe(self, key: str, take: Callable[[bytes, bytes | None], None]) -> Inlet:
        """Subscribe to messages of others.

        Args:
            key: Key expression of the messages.
            take: Called with payload and attachment on a Zenoh thread; while it waits, so does the link.
        """
        from riot_bus.zenoh import api as zenoh

        pin(self._session, key)
        return Inlet(self._session.declare_subscriber(key, receiver(take), allowed_origin=zenoh.Locality.REMOTE))

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
            timeout=24 * 3600.0,  # rmw_zenoh waits for ever
            allowed_destination=zenoh.Locality.REMOTE,
            cancellation_token=asked.token,
        )
        return asked

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        release(self._session)
        end_pinning(self._session)


PortT = TypeVar("PortT", bound=SegmentPort)


def open_port(kind: type[PortT], endpoints: Sequence[str], *, config: Mapping[str, Any] | None = None) -> PortT:
    """Connect to a segment; the first endpoint that answers is used.

    Raises:
        ConfigError: Zenoh refuses the configuration.
        EnvironmentFaultError: No endpoint answers.
    """
    prepare_runtime()
    extra = {"timestamping/enabled": True, **(config or {})}
    failure: EnvironmentFaultError | None = None
    for endpoint in endpoints:
        try:
            return kind(open_session(client_config(endpoint, extra=extra), purpose="bridge"), endpoint)
        except EnvironmentFaultError as error:
            failure = failure or error
    raise failure or EnvironmentFaultError("the segment has no endpoint", where="bridge")


def settings_of(*, reliable: bool) -> dict[str, Any]:
    """Return the settings of a publisher for others, which waits for slow receivers or loses messages."""
    from riot_bus.zenoh import api as zenoh

    return {
        "congestion_control": zenoh.CongestionControl.BLOCK if reliable else zenoh.CongestionControl.DROP,
        "reliability": zenoh.Reliability.RELIABLE if reliable else zenoh.Reliability.BEST_EFFORT,
        "allowed_destination": zenoh.Locality.REMOTE,
    }


def receiver(take: Callable[[bytes, bytes | None], None]) -> Any:
    """Return what calls a function with payload and attachment of each message but deletes, on a Zenoh thread."""
    from riot_bus.zenoh import api as zenoh

    def receive(sample: zenoh.Sample) -> None:
        if not is_delete(sample):
            take(*message_of(sample))

    return zenoh.handlers.Callback(receive, indirect=False)


def message_of(sample: zenoh.Sample) -> tuple[bytes, bytes | None]:
    """Return payload and attachment."""
    attachment = sample.attachment
    return sample.payload.to_bytes(), None if attachment is None else attachment.to_bytes()
