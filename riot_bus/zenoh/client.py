"""A client of one router: for recording a live network, and for tests."""

from __future__ import annotations

import itertools
import threading
from collections import Counter
from typing import TYPE_CHECKING, Any, Self

from riot_bus.pipeline.mailbox import Dispatcher
from riot_bus.vocabulary.message import Qos
from riot_bus.zenoh.convert import Converter, Outlets
from riot_bus.zenoh.session import canonical, open_session, prepare_runtime, release
from riot_bus.zenoh.session_config import client_config

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import zenoh

    from riot_bus.vocabulary.message import Message

Subscription = Any
"""Something with `undeclare()`."""


class Client:
    """A client session that publishes and receives messages; a context manager.

    Attributes:
        lost: Number of messages lost because of a slow callback, by key.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self.zid = str(session.info.zid())
        self.lost: Counter[str] = Counter()
        self._lock = threading.Lock()
        self._outlets = Outlets(session)
        self._convert = Converter("", itertools.count(1))
        self._dispatcher = Dispatcher("riot-client", self._count_lost)

    def subscribe(self, keyexpr: str, callback: Callable[[Message], None]) -> Subscription:
        """Call back with each message, on a thread that may be slow without stalling the link."""
        (text,) = canonical([keyexpr])
        self._dispatcher.start()
        convert, deliver = self._convert, self._dispatcher.deliver
        return self.session.declare_subscriber(text, lambda sample: deliver(callback, convert(sample)))

    def put(self, message: Message) -> None:
        """Publish a message: put or delete, with its QoS but without its time and sequence number."""
        self._outlets.publish(message)

    def declare(self, key: str, qos: Qos = Qos()) -> None:  # noqa: B008 - immutable
        """Declare a publisher ahead of its first message."""
        self._outlets.publisher(key, qos)

    def close(self) -> None:
        """Disconnect, then make the calls that are queued; safe to call twice."""
        release(self.session)
        self._dispatcher.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _count_lost(self, message: Message) -> None:
        with self._lock:
            self.lost[message.key] += 1


def open_client(endpoint: str, *, config: Mapping[str, Any] | None = None) -> Client:
    """Connect to a router.

    Raises:
        EnvironmentFaultError: There is no answer from the endpoint.
    """
    prepare_runtime()
    return Client(open_session(client_config(endpoint, extra=config), purpose="client"))
