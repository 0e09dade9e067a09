"""Exchange of frames as JSON, on the keys of mavlink-server."""

from __future__ import annotations

import json
import queue
import threading
from collections import Counter
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_bridges.mavlink.losses import MOST_IDS
from riot_bus_mavlink.frame import parse_frame

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.types.port import Closeable, PortPublisher
    from riot_bus_bridges.mavlink.json_form import JsonForm
    from riot_bus_bridges.mavlink.streams import OwnStreams
    from riot_bus_bridges.port import BridgePort
    from riot_bus_mavlink.frame import Frame

IN, OUT = "mavlink/in", "mavlink/out"
ENCODING = "application/json;mavlink"
_MOST_QUEUED = 1024  # batches
_END_S = 5.0  # generous: the thread ends after the batch that it has begun; not measured
_MARK = b"mavlink-json-1"


class Mirror:
    """Publishes JSON on `mavlink/{sysid}/{compid}/{MESSAGE}` and `mavlink/out`, on a thread of its own.

    Frames that it has no time for are dropped and counted: nothing waits for it.

    Args:
        port: The segment.
        form: Writes and reads JSON.
        fields: Whether each field is also published, on `mavlink/{sysid}/{compid}/{MESSAGE}/{field}`.
        streams: Numbers the incoming frames.
        insert: Called with frames that others have put on `mavlink/in`; None to accept none.

    Attributes:
        counts: Numbers of frames: `mirrored`, `mirror_lost`, `json_in`, `json_refused`.
    """

    def __init__(
        self,
        port: BridgePort,
        form: JsonForm,
        *,
        fields: bool,
        streams: OwnStreams,
        insert: Callable[[Frame], None] | None,
    ) -> None:
        self.counts: Counter[str] = Counter()
        self._port, self._form, self._fields, self._streams, self._insert = port, form, fields, streams, insert
        self._outlets: dict[str, PortPublisher] = {}
        self._queue: queue.Queue[Sequence[bytes] | None] = queue.Queue(_MOST_QUEUED)
        self._inlet: Closeable | None = None
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="mavlink-mirror", daemon=True)

    def open(self) -> None:
        """Start publishing and listening."""
        self._thread.start()
        if self._insert is not None:
            self._inlet = self._port.subscribe(IN, partial(self._hear, self._insert))

    def close(self) -> None:
        """Stop soon; frames still in the queue are dropped."""
        if self._inlet is not None:
            self._inlet.close()
        self._ended = True
        with suppress(queue.Full):
            self._queue.put_nowait(None)
        if self._thread.is_alive():
            self._thread.join(_END_S)
        for outlet in self._outlets.values():
            outlet.close()

    def offer(self, raws: Sequence[bytes]) -> None:
        """Queue whole frames to be published."""
        try:
            self._queue.put_nowait(raws)
        except queue.Full:
            self.counts["mirror_lost"] += len(raws)

    def _run(self) -> None:
        while (raws := self._queue.get()) is not None and not self._ended:
            for raw in raws:
                try:
                    self._publish(parse_frame(raw))
                except Exception:  # the segment is gone; it may come back
                    self.counts["mirror_lost"] += 1

    def _publish(self, frame: Frame) -> None:
        document = self._form.document(frame)
        if document is None:
            return
        text = json.dumps(document, separators=(",", ":")).encode()
        message = document["message"]
        base = f"mavlink/{frame.system}/{frame.component}/{message['type']}"
        self._outlet(OUT).put(text, _MARK)
        self._outlet(base).put(text, _MARK)
        if self._fields:
            for name, value in message.items():
                self._outlet(f"{base}/{name}").put(json.dumps(value, separators=(",", ":")).encode(), _MARK)
        self.counts["mirrored"] += 1

    def _outlet(self, key: str) -> PortPublisher:
        outlet = self._outlets.get(key)
        if outlet is None:
            if len(self._outlets) >= MOST_IDS:
                self._outlets.pop(next(iter(self._outlets))).close()
            outlet = self._outlets[key] = self._port.publisher(key, reliable=True, encoding=ENCODING)
        return outlet

    def _hear(self, insert: Callable[[Frame], None], payload: bytes, attachment: bytes | None) -> None:
        try:
            frame = self._form.frame(payload, self._streams.next)
        except PayloadError:
            self.counts["json_refused"] += 1
            return
        self.counts["json_in"] += 1
        insert(frame)
