"""What a bus does in its segments on behalf of players, monitors and trial runners: observe, answer, and publish."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from riot_bus.pipeline.mailbox import Dispatcher
from riot_bus.pipeline.runner import BoundedCounts
from riot_bus.router.advanced.proxy_publisher import StoreFilter
from riot_bus.router.services.recorded import serve_recorded
from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.router.services.recorded import RecordedService
    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh
    from riot_bus.zenoh.client import Subscription
    from riot_bus.zenoh.convert import Converter
    from riot_bus.zenoh.segments import Segment


class Observers:
    """Subscribers, stand-ins for services and probes of a bus; callbacks run on one thread.

    Attributes:
        slow: Messages, by topic, for which there was no room because callbacks are too slow.
    """

    def __init__(self, topic: Callable[[str], str]) -> None:
        self.slow = BoundedCounts()
        self._dispatcher = Dispatcher("riot-observe", lambda message: self.slow.add(topic(message.key)))
        self._declared: list[Any] = []
        self._tokens: dict[str, Any] = {}
        self._probes: dict[tuple[str, str], zenoh.Publisher] = {}

    def subscribe(
        self, segment: Segment, text: str, callback: Callable[[Message], None], *, own: bool, convert: Converter
    ) -> Subscription:
        """Call a function with each message on a segment."""
        session = segment.session
        self._dispatcher.start()
        only_stored = StoreFilter(segment.zid)

        def take(sample: zenoh.Sample) -> None:
            if not only_stored(sample):
                self._dispatcher.deliver(callback, convert(sample))

        pin(session, text)
        locality = library_of(session).Locality
        subscriber = session.declare_subscriber(text, take, allowed_origin=locality.ANY if own else locality.REMOTE)
        self._declared.append(subscriber)
        return subscriber

    def serve(self, session: zenoh.Session, key: str, service: RecordedService, tokens: Sequence[str]) -> None:
        """Answer calls with recorded replies; see `Bus.serve`."""
        self._declared.append(serve_recorded(session, key, service))
        for token in tokens:
            if token not in self._tokens:
                self._tokens[token] = session.liveliness().declare_token(token)

    def hears(self, segment: Segment, key: str) -> bool:
        """Return whether a component of a segment has subscribed to a key."""
        probe = self._probes.get((segment.name, key))
        if probe is None:
            session = segment.session
            pin(session, key)
            remote = library_of(session).Locality.REMOTE
            probe = self._probes[segment.name, key] = session.declare_publisher(key, allowed_destination=remote)
        return bool(getattr(probe.matching_status, "matching", True))

    def idle(self) -> bool:
        """Return whether every callback was called."""
        return self._dispatcher.idle()

    def close(self) -> None:
        """Make the calls that are due, and end; safe to call twice."""
        self._dispatcher.close()
        release(*self._probes.values())
        for each in (*self._declared, *self._tokens.values()):
            with suppress(library_of(each).ZError):  # its user has undeclared it
                release(each)
        for table in (self._probes, self._declared, self._tokens):
            table.clear()


def wait_subscribed(
    session: zenoh.Session, expressions: Sequence[str], *, timeout: float, alive: Callable[[], bool]
) -> list[str]:
    """Wait until components have subscribed to all canonical key expressions; see `Bus.wait_subscribed`."""
    zenoh = library_of(session)
    # The admin space would give an exact answer, but a query there during a declaration can block the whole
    # router for ever (zenoh 1.10.2 locks its tables twice).
    waiting: dict[str, Any] = {}
    listeners: dict[str, Any] = {}
    changed = threading.Event()
    deadline = time.monotonic() + timeout
    try:
        for text in expressions:
            pin(session, text)
            waiting[text] = session.declare_publisher(text, allowed_destination=zenoh.Locality.REMOTE)
            handler: Any = zenoh.handlers.Callback(lambda status: changed.set(), indirect=False)
            listeners[text] = waiting[text].declare_matching_listener(handler)
        while True:
            changed.clear()
            for text in [text for text, each in waiting.items() if each.matching_status.matching]:
                release(listeners.pop(text), waiting.pop(text))
            left = deadline - time.monotonic()
            if not waiting or left <= 0 or not alive():
                return list(waiting)
            changed.wait(min(left, 0.02))  # so late a component's end is noticed
    finally:
        release(*listeners.values(), *waiting.values())
