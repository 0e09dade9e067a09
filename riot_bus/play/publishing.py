"""Publishers of the played messages: recorded QoS, latching, tokens, attachments; and what was lost."""

from __future__ import annotations

import time
from collections import Counter
from typing import TYPE_CHECKING, Any

from riot_bus.types.capabilities import Identity, Offer
from riot_bus.vocabulary.message import Qos
from riot_bus.zenoh.convert import publisher_settings
from riot_bus.zenoh.session import release
from riot_bus.zenoh.session_config import HEARTBEAT_S

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh

_USUAL = Qos()
_MOST_KEYS = 4096  # that interceptors may invent


class Publishing:
    """Publication of messages into one session, by one thread at a time.

    Zenoh's timestamps and source information are always new, since subscribers drop messages where they do not grow.

    Args:
        offers: Publisher settings by key; other keys are published as they are.
        block: Whether a slow subscriber holds up the player, whatever was recorded, so that nothing is dropped.

    Attributes:
        lost: Number of messages by key that could not be published, or for which there was no link.
        problems: The first error for each key.
    """

    def __init__(self, session: zenoh.Session, offers: Mapping[str, Offer], *, block: bool) -> None:
        self.lost: Counter[str] = Counter()
        self.problems: dict[str, str] = {}
        self._session = session
        self._block = block
        self.zid = str(session.info.zid())
        self._outlets: dict[str, _Outlet] = {}
        self._most = len(offers) + _MOST_KEYS
        self._tokens: dict[str, Any] = {}
        self._entities = 0
        self._links = _Links(session)
        for offer in offers.values():
            self._open(offer)

    @property
    def broken(self) -> int:
        """How often the link to the router broke."""
        return self._links.broken

    def publish(self, message: Message) -> None:
        """Publish; never raises, but counts what is lost."""
        try:
            outlet = self._outlets.get(message.key) or self._open(Offer(message.key))
            outlet.put(message)
        except Exception as error:
            self.lost[message.key] += 1
            self.problems.setdefault(message.key, str(error))
        else:
            if not self._links.up:
                self.lost[message.key] += 1
                self.problems.setdefault(message.key, "there was no link to the router")

    def unmatched(self) -> list[str]:
        """Return the keys that have no subscriber."""
        return [key for key, outlet in self._outlets.items() if not outlet.matched()]

    def flush(self, timeout: float) -> bool:
        """Wait until the router has all that was published; return False if it does not say so in time."""
        from riot_bus.zenoh import api as zenoh

        # A query takes the same route, behind everything that was published before.
        question = self._session.get(
            f"@riot/{self.zid}/flush",
            priority=zenoh.Priority.BACKGROUND,
            congestion_control=zenoh.CongestionControl.BLOCK,
            timeout=timeout,
        )
        began = time.monotonic()
        for _ in question:
            pass
        return time.monotonic() - began < timeout

    def close(self) -> None:
        """Undeclare all publishers and tokens."""
        release(self._links, *self._tokens.values())
        self._tokens.clear()
        for outlet in self._outlets.values():
            release(*outlet.publishers())
        self._outlets.clear()

    def _open(self, offer: Offer) -> _Outlet:
        if len(self._outlets) >= self._most:
            raise ValueError(f"interceptors have invented more than {_MOST_KEYS} keys")
        self._entities += 1
        identity = offer.identify(self.zid, self._entities) if offer.identify is not None else Identity()
        outlet = self._outlets[offer.key] = _Outlet(self._session, offer, identity, block=self._block)
        for token in identity.tokens:
            if token not in self._tokens:
                self._tokens[token] = self._session.liveliness().declare_token(token)
        return outlet


class _Outlet:
    """The publisher of one key."""

    def __init__(self, session: zenoh.Session, offer: Offer, identity: Identity, *, block: bool) -> None:
        from riot_bus.zenoh import api as zenoh

        self._session, self._offer, self._block = session, offer, block or offer.block
        self._attachment = identity.attachment
        self._sequence = 0
        self._by_qos: dict[Qos, Any] = {}
        self._encodings: dict[str, Any] = {}
        # Unlike advanced publishers, it also tells whether there is a subscriber.
        self._usual: Any = session.declare_publisher(
            offer.key, allowed_destination=zenoh.Locality.REMOTE, **self._settings(_USUAL)
        )
        self._by_qos[_USUAL] = self._usual
        self._latch = self._declare_latched() if offer.depth is not None else None

    def matched(self) -> bool:
        return bool(self._usual.matching_status.matching)

    def publishers(self) -> Iterator[Any]:
        yield from self._by_qos.values()
        if self._latch is not None:
            yield self._latch

    def put(self, message: Message) -> None:
        publisher = self._latch or self._by_qos.get(message.qos) or self._declare(message.qos)
        attachment = message.attachment
        if self._attachment is not None:
            self._sequence += 1
            attachment = self._attachment(attachment, self._sequence, time.time_ns())
        if message.kind == "delete":
            publisher.delete(attachment=attachment)
        else:
            encoding = self._encodings.get(message.encoding) or self._encoding(message.encoding)
            publisher.put(message.payload, encoding=encoding, attachment=attachment)

    def _declare(self, qos: Qos) -> Any:
        if len(self._by_qos) >= _MOST_KEYS:
            release(*(each for each in self._by_qos.values() if each is not self._usual))
            self._by_qos = {_USUAL: self._usual}
        publisher = self._session.declare_publisher(self._offer.key, **self._settings(qos))
        self._by_qos[qos] = publisher
        return publisher

    def _declare_latched(self) -> Any:
        from riot_bus.zenoh.api import ext

        beats = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S)
        return ext.declare_advanced_publisher(
            self._session,
            self._offer.key,
            cache=ext.CacheConfig(self._offer.depth),
            sample_miss_detection=beats if self._offer.reliable else None,
            publisher_detection=True,
            **self._settings(_USUAL),
        )

    def _settings(self, qos: Qos) -> dict[str, Any]:
        if self._block and qos.congestion == "drop":
            qos = Qos(qos.priority, "block", qos.express)
        from riot_bus.zenoh import api as zenoh

        return publisher_settings(qos, zenoh)

    def _encoding(self, text: str) -> Any:
        from riot_bus.zenoh import api as zenoh

        if len(self._encodings) >= _MOST_KEYS:
            self._encodings.clear()
        found = self._encodings[text] = zenoh.Encoding(text or "zenoh/bytes")
        return found


class _Links:
    """Whether there is a link, and how often one broke: messages published without a link are silently lost."""

    def __init__(self, session: zenoh.Session) -> None:
        self.broken = 0
        self._open: set[str] = {str(each.zid) for each in session.info.transports()}
        self._listener: Any = session.info.declare_transport_events_listener(self._event)

    @property
    def up(self) -> bool:
        return bool(self._open)

    def undeclare(self) -> None:
        release(self._listener)

    def _event(self, event: zenoh.TransportEvent) -> None:
        from riot_bus.zenoh import api as zenoh

        if event.kind == zenoh.SampleKind.PUT:
            self._open.add(str(event.transport.zid))
        else:
            self._open.discard(str(event.transport.zid))
            self.broken += 1
