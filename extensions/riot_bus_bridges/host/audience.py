"""The subscribers of what this process publishes on a segment: components, and bridges in the same process."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, NamedTuple

from riot_bus.zenoh.convert import publisher_settings
from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.types.port import Take
    from riot_bus.vocabulary.message import Qos
    from riot_bus.zenoh import api as zenoh


class Inner(NamedTuple):
    """A bridge in this process that listens.

    Attributes:
        expression: Key expression that it listens to.
        take: Called with payloads and attachments, on any thread; raises nothing.
    """

    expression: zenoh.KeyExpr
    take: Take


class Audience:
    """Publishes on one key to the components of a segment, as long as any of them subscribes.

    Args:
        encoding: Zenoh's encoding string, empty for its default.
        changed: Function called on a thread of Zenoh's when the result of `listens` may have changed.
        everywhere: Whether to publish always, and to this process, too.
        took: Function called with the duration of each publication, in seconds.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        *,
        qos: Qos,
        encoding: str = "",
        changed: Callable[[], None] | None = None,
        everywhere: bool = False,
        took: Callable[[float], None] | None = None,
    ) -> None:
        zenoh = library_of(session)
        pin(session, key)
        self._publisher: Any = session.declare_publisher(
            key,
            encoding=zenoh.Encoding(encoding) if encoding else None,
            allowed_destination=zenoh.Locality.ANY if everywhere else zenoh.Locality.REMOTE,
            **publisher_settings(qos, zenoh),
        )
        self._put = self._publisher.put
        self._changed, self._everywhere, self._took = changed, everywhere, took
        self._listens, self._stale = everywhere, not everywhere
        handler: Any = zenoh.handlers.Callback(self._note, indirect=False)  # indirect: a thread for each handler
        self._listener = self._publisher.declare_matching_listener(handler)

    def put(self, payload: bytes, attachment: bytes | None) -> None:
        """Publish; waits for slow receivers if the QoS says so. Raises zenoh.ZError when the session is closed."""
        if self._stale:
            self._stale = False  # first, so that no change is missed
            self._listens = self.listens()
        if self._listens:
            began = time.monotonic()
            try:
                self._put(payload, attachment=attachment)
            finally:
                if self._took is not None:
                    self._took(time.monotonic() - began)

    def listens(self) -> bool:
        """Return whether there is a subscriber."""
        return bool(self._publisher.matching_status.matching)

    def close(self) -> None:
        """Stop publishing and release the publisher."""
        release(self._listener, self._publisher)

    def _note(self, status: object) -> None:
        self._stale = not self._everywhere
        if self._changed is not None:
            self._changed()
