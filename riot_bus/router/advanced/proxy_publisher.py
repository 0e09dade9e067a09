"""Proxy of an advanced publisher in another segment: a silent cache, and a plain publisher with the same numbers."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of, moved
from riot_bus.zenoh.session import release

if TYPE_CHECKING:
    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh
    from riot_bus.zenoh.convert import Outlets

_MOST_SKIPPED = 256  # puts of 1.2 us (measured) on the worker's thread: 0.3 ms; a forged heartbeat may claim 2**32


class ProxyPublisher:
    """Proxy in one segment for an advanced publisher of another; calls are serialised by `PublisherState`.

    Args:
        depth: Number of samples to keep, 0 for no cache, None if unknown.
    """

    def __init__(self, outlets: Outlets, session: zenoh.Session, key: str, depth: int | None) -> None:
        self._session, self._key, self._outlets = session, key, outlets
        self._library = library_of(session)
        self._quiet = False  # a beat would make present subscribers fetch what they have had already
        self._kept: deque[tuple[Message, Any]] = deque()
        self._token: Any = None
        self._declare(depth)

    def _declare(self, depth: int | None) -> None:
        ext = self._library.ext
        pin(self._session, self._key)
        self._cache: Any = ext.declare_advanced_publisher(
            self._session,
            self._key,
            cache=None if depth == 0 else ext.CacheConfig(depth or 1 << 20),
            sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
            allowed_destination=self._library.Locality.SESSION_LOCAL,
        )
        self._depth, self._next, self._beaten = depth, 0, 0
        self.cache = f"{self._key}/@adv/pub/{self._cache.id.zid}/{self._cache.id.eid}/_"
        """Key on which the cache answers."""
        pin(self._session, self.cache)  # subscribers query this key after a token, even if the cache is replaced

    def announce(self, number: int, *, again: bool) -> None:
        """Show a token.

        Args:
            number: Number used instead of the entity if `again`.
            again: Whether present subscribers have had the history, so that the token must not lead to it.
        """
        self._quiet = again
        key = f"{self._key}/@adv/pub/{self._cache.id.zid}/{number}/_" if again else self.cache
        self._token = self._session.liveliness().declare_token(key)

    def store(self, message: Message, stamp: Any) -> int:
        """Put a message only into the cache, and return its number."""
        stamp = moved(stamp, self._library)
        if message.kind == "delete":
            self._cache.delete(attachment=message.attachment, timestamp=stamp)
        else:
            encoding = self._outlets.encoding(message.encoding)
            self._cache.put(message.payload, encoding=encoding, attachment=message.attachment, timestamp=stamp)
        if self._depth is None:
            self._kept.append((message, stamp))
        self._next += 1
        return self._next - 1

    def send(self, message: Message, number: int, stamp: Any) -> None:
        """Publish what was stored."""
        stamp = moved(stamp, self._library)
        publisher = self._outlets.publisher(message.key, message.qos)
        info = self._library.SourceInfo(self._cache.id, number)
        if message.kind == "delete":
            publisher.delete(attachment=message.attachment, timestamp=stamp, source_info=info)
        else:
            encoding = self._outlets.encoding(message.encoding)
            publisher.put(
                message.payload, encoding=encoding, attachment=message.attachment, timestamp=stamp, source_info=info
            )
        self._quiet = False

    def publish(self, message: Message) -> None:
        """Store and send."""
        stamp = self._session.new_timestamp()
        self.send(message, self.store(message, stamp), stamp)

    def skip(self, numbers: int) -> None:
        """Skip numbers, so that subscribers notice messages that cannot be recovered; only without a cache."""
        for _ in range(min(numbers, _MOST_SKIPPED)):
            self._cache.put(b"")
            self._next += 1

    def beat(self) -> None:
        """Send a heartbeat with the last number, if it has changed."""
        from riot_bus.zenoh.api import ext

        if self._next != self._beaten and not self._quiet:
            self._beaten = self._next
            number: Any = ext.UInt32(self._next - 1)
            block = self._library.CongestionControl.BLOCK
            self._session.put(self.cache, ext.z_serialize(number).to_bytes(), congestion_control=block)

    def resize(self, depth: int) -> None:
        """Keep only the last samples from now on, in another cache, which present subscribers should not query."""
        kept, self._kept = list(self._kept)[-depth:] if depth else [], deque()
        release(self._cache)
        self._declare(depth)
        self._quiet = True
        for message, stamp in kept:
            self.store(message, stamp)

    def close(self) -> None:
        """Undeclare the token and the cache."""
        release(*[each for each in (self._token, self._cache) if each is not None])


class StoreFilter:
    """Filter of samples that are only stored, for observers within the router, which alone receive puts into caches.

    Numbers of one cache grow, and each sample is stored before it is sent.
    """

    def __init__(self, zid: str) -> None:
        self._zid = zid
        self._stored: dict[int, int] = {}

    def __call__(self, sample: Any) -> bool:
        """Return whether a sample is only stored; call this for all samples of the session, in their order."""
        info = sample.source_info
        if info is None or str(info.source_id.zid) != self._zid:
            return False
        entity, number = info.source_id.eid, info.source_sn
        if number <= self._stored.get(entity, -1):
            return False
        self._stored[entity] = number
        return True
