"""One segment of a bridge: frames between its links, and between the links and the bus."""

from __future__ import annotations

import secrets
import threading
import time
from collections import Counter
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_bridges.links.end import Flow
from riot_bus_bridges.mavlink.sequences import MOST_IDS
from riot_bus_mavlink.frame import ENCODING, KIND, LONGEST, V2, is_plain, parse_frame
from riot_bus_mavlink.signing import Renewer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from riot_bus.types.port import Closeable, PortPublisher
    from riot_bus_bridges.host.inner import BridgePort
    from riot_bus_bridges.links.end import End
    from riot_bus_bridges.mavlink.mirror import Mirror
    from riot_bus_bridges.mavlink.routing import Routes
    from riot_bus_bridges.mavlink.sequences import OwnStreams
    from riot_bus_mavlink.frame import Frame
    from riot_bus_mavlink.keys import KeyTemplate
    from riot_bus_mavlink.signing import Signer

_MAGIC = b"mavlink-link-1 "
INSERTED = _MAGIC + b"inserted"
"""Attachment of frames that a bridge put on the bus for another sender; they are numbered already."""


class Side:
    """Carries frames between the links of one segment, and between them and the bus.

    Frames from a link are put on the bus and sent to the other links; they arrive on one thread at a time. Frames from
    the bus are sent to the links; they, too, arrive on one thread at a time, which may be that of the links.

    Args:
        signer: Signer with the key of signed frames; None to pass them on unchanged.

    Attributes:
        counts: Numbers of frames: `to_bus`, `lost_to_bus` (could not be put on the bus), `from_bus`, `inserted` (by
            others than links), `broken` (no whole frames), `unrouted` (wanted by no link), and `refused` (empty, too
            long for a link, or impossible to re-sign).
    """

    def __init__(
        self,
        port: BridgePort,
        routes: Routes[End],
        *,
        keys: KeyTemplate,
        name_of: Callable[[int], str],
        mark: bytes,
        streams: OwnStreams,
        linked: Callable[[int, int], bool],
        signer: Signer | None = None,
    ) -> None:
        self.port, self.routes = port, routes
        self.counts: Counter[str] = Counter()
        self.streams = streams
        self.mirror: Mirror | None = None
        self._keys, self._name_of, self._mark, self._linked = keys, name_of, mark, linked
        self._extra = streams.crc_extra
        self._renewer = None if signer is None else Renewer(signer)
        self._outlets: dict[tuple[str, int, int, int], PortPublisher] = {}
        self._deliveries: dict[bytes, tuple[int, list[End]]] = {}
        self._inlet: Closeable | None = None
        self._lock, self._declaring = threading.Lock(), threading.Lock()

    @property
    def is_open(self) -> bool:
        """Whether this side listens to the bus."""
        return self._inlet is not None

    def published(self) -> list[tuple[str, int, int, str]]:
        """Return link, system, component and key of what was put on the bus so far."""
        return [
            (link, system, component, self._keys.key(link, system, component, self._name_of(message_id)))
            for link, system, component, message_id in list(self._outlets)
        ]

    def open(self) -> None:
        """Listen to the bus; to be called once."""
        self._inlet = self.port.collect(self._keys.expression(), self.deliver)

    def await_subscriber(self, seconds: float) -> bool:
        """Wait for a subscriber on the bus, without which the first frames would be lost; return whether it came."""
        matched = threading.Event()
        outlet = self.port.publisher(self._keys.key("any", 0, 0, "ANY"), reliable=True, changed=matched.set)
        try:
            deadline = time.monotonic() + seconds
            while not outlet.matched() and (left := deadline - time.monotonic()) > 0:
                matched.wait(left)
                matched.clear()
            return outlet.matched()
        finally:
            outlet.close()

    def stop_listening(self) -> None:
        """Stop listening to the bus, after the links have got what arrived."""
        inlet, self._inlet = self._inlet, None
        if inlet is not None:
            inlet.close()

    def close(self) -> None:
        """Close the side, after its links."""
        self.stop_listening()
        for outlet in self._outlets.values():
            outlet.close()
        self._outlets.clear()

    def receive(self, end: End, packets: Sequence[bytes]) -> None:
        """Carry packets, or pieces of a stream, that came over an end of a link, in their order."""
        at = 0
        while at < len(packets):
            flows = end.framer.known(packets, at, self._flows(end))
            self._carry(end, flows, packets[at : at + len(flows)])
            at += len(flows)
            if at < len(packets):
                self.receive_frames(end, end.framer.feed(packets[at]))
                at += 1

    def receive_frames(self, end: End, frames: Iterable[Frame]) -> None:
        """Carry frames that came over a link; those of known flows together."""
        now = time.monotonic()
        flows: list[Flow] = []
        raws: list[bytes] = []
        for frame in frames:
            flow = self._flows(end).get(frame.raw[KIND]) if frame.version == 2 else None
            if flow is not None:
                flows.append(flow)
                raws.append(frame.raw)
            else:
                self._carry(end, flows, raws)
                flows, raws = [], []
                self._receive_new(end, frame, now)
        self._carry(end, flows, raws)

    def _receive_new(self, end: End, frame: Frame, now: float) -> None:
        """Carry a frame, unless it is dropped, and remember its route."""
        routes, raw = self.routes, frame.raw
        end.losses.see(frame.system, frame.component, frame.sequence)
        generation = routes.generation
        others = routes.receive(frame, end, now)
        if others is None:
            return
        for other in others:
            other.send(raw)
        place = (end.link, frame.system, frame.component, frame.message_id)
        self.counts["to_bus"] += 1
        try:
            outlet = self._outlets.get(place) or self._outlet(place)
            outlet.put(raw, self._mark)
        except Exception:  # the segment is gone; its links still exchange frames
            self.counts["lost_to_bus"] += 1
        else:
            self._remember(frame, end, generation, others, outlet)
        if self.mirror is not None:
            self.mirror.offer([raw])

    def _carry(self, end: End, flows: Sequence[Flow], raws: Sequence[bytes]) -> None:
        if not flows:
            return
        end.counts["in"] += len(raws)
        self.counts["to_bus"] += len(raws)
        for flow, raw in zip(flows, raws, strict=True):
            flow.count.see(raw[4])
            for other in flow.others:
                other.send(raw)
        failed = self.port.put_all([flow.outlet for flow in flows], raws, self._mark)
        if failed:  # the segment is gone; its links still exchange frames
            self.counts["lost_to_bus"] += failed
        if self.mirror is not None:
            self.mirror.offer(raws)

    def _flows(self, end: End) -> dict[bytes, Flow]:
        """Return the known flows of an end; none if the routes have changed since."""
        if end.generation != self.routes.generation:
            end.flows.clear()
            end.generation = self.routes.generation
        return end.flows

    def _remember(self, frame: Frame, end: End, generation: int, others: Sequence[End], outlet: PortPublisher) -> None:
        """Remember the route of frames like this one."""
        extra = self._extra(frame.message_id)
        count = end.losses.of(frame.system, frame.component)
        if frame.version == 2 and extra is not None and count is not None and self.routes.settled(frame.message_id):
            flows = self._flows(end)
            if len(flows) >= MOST_IDS:
                flows.clear()
            if end.generation == generation:
                flows[frame.raw[KIND]] = Flow(bytes([extra]), count, others, outlet)

    def deliver(self, messages: Sequence[tuple[bytes, bytes | None]]) -> None:
        """Carry what came from the bus, payloads and attachments; one thread at a time.

        Consecutive frames for the same ends go with one call for each end. Nothing here calls per frame, since a call
        costs as much as all the checks; so `is_plain` is inlined.
        """
        known, own, routes = self._deliveries, self._mark, self.routes
        raws: list[bytes] = []
        ends: list[End] = []
        for payload, attachment in messages:
            found, size = known.get(payload[KIND]), len(payload)
            if (
                found is None
                or found[0] != routes.generation
                or attachment != own
                or size < 12  # this and the next three: `is_plain`
                or payload[0] != V2
                or payload[1] != size - 12
                or payload[2]
            ):
                self._send_together(raws, ends)
                raws = []
                self._deliver_new(payload, attachment)
                continue
            if raws and found[1] is not ends and found[1] != ends:
                self._send_together(raws, ends)
                raws = []
            ends = found[1]
            raws.append(payload)
        self._send_together(raws, ends)

    def _send_together(self, raws: Sequence[bytes], ends: Sequence[End]) -> None:
        if raws:
            self.counts["from_bus"] += len(raws)
            for end in ends:
                end.send_all(raws)

    def _deliver_new(self, payload: bytes, attachment: bytes | None) -> None:
        own = attachment == self._mark
        try:
            frame = parse_frame(payload)
        except PayloadError:
            self._deliver_broken(payload)
            return
        if not is_mark(attachment) and self._linked(frame.system, frame.component):
            payload = self._renumbered(frame)
        generation = self.routes.generation
        ends = self.routes.deliver(frame, looped=own)
        if ends and own and is_plain(payload) and self.routes.settled(frame.message_id):
            if len(self._deliveries) >= MOST_IDS:
                self._deliveries.clear()
            self._deliveries[payload[KIND]] = generation, ends
        counts = self.counts
        counts["from_bus"] += 1
        counts["unrouted"] += not ends
        if frame.signed and ends and self._renewer is not None:
            try:
                payload = self._renewer.renew(payload)  # it may be late, repeated, or from a log
            except PayloadError:
                counts["refused"] += 1
                return
        for end in ends:
            end.send(payload)

    def insert(self, frame: Frame, link: str) -> None:
        """Send a numbered frame that did not come over a link to the links and the bus."""
        for end in self.routes.deliver(frame, looped=False):
            end.send(frame.raw)
        with self._lock:
            self.counts["inserted"] += 1
        self._outlet((link, frame.system, frame.component, frame.message_id)).put(frame.raw, INSERTED)

    def _renumbered(self, frame: Frame) -> bytes:
        with self._lock:
            self.counts["inserted"] += 1
            return self.streams.renumber(frame)

    def _deliver_broken(self, payload: bytes) -> None:
        """Send a payload that is not a frame to all links unchanged: it was broken on purpose and names no target."""
        fits = 0 < len(payload) <= LONGEST
        self.counts["from_bus"] += 1
        self.counts["broken" if fits else "refused"] += 1
        if fits:
            for end in self.routes.peers:
                if end.sends:
                    end.send(payload)

    def _outlet(self, place: tuple[str, int, int, int]) -> PortPublisher:
        with self._declaring:
            outlet = self._outlets.get(place)
            if outlet is None:
                if len(self._outlets) >= MOST_IDS:
                    self._outlets.pop(next(iter(self._outlets))).close()
                    self.routes.forget()
                link, system, component, message_id = place
                key = self._keys.key(link, system, component, self._name_of(message_id))
                outlet = self._outlets[place] = self.port.publisher(key, reliable=True, encoding=ENCODING)
            return outlet


def new_mark() -> bytes:
    """Return a new attachment for the frames of one bridge that came over its links."""
    return _MAGIC + secrets.token_bytes(8)


def is_mark(attachment: bytes | None) -> bool:
    """Return whether a frame came over a link: of this bridge or another, or of an earlier one if played from a log."""
    return attachment is not None and attachment.startswith(_MAGIC)
