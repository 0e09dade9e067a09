"""Contents of a sample: payload, kind, encoding and attachment."""

from __future__ import annotations

from riot_bus.zenoh import api as zenoh
from riot_bus_conformance.end import BLOCK, Observation, ScenarioEnd
from riot_bus_conformance.scenario import scenario

_SIZES = (0, 1, 1 << 16, 10 << 20)  # none, one byte, one more than a batch of Zenoh, 160 batches
_ENCODINGS = (
    None,
    "zenoh/bytes",
    "zenoh/bytes;schema",
    "zenoh/string",
    "zenoh/serialized;Odometry",
    "application/json",
    "application/cdr;nav_msgs/msg/Odometry",
    "text/plain;charset=utf-8",
    "video/h264",
    "rover/own-format;v=1;w=2",
    ";only a schema",
    "",
    zenoh.Encoding.APPLICATION_PROTOBUF.with_schema("a.B"),
)


class _ReadingEnd(ScenarioEnd):
    """An end whose right side reports all samples."""

    def right(self) -> Observation:
        return self.everything()


@scenario("payload_sizes")
class _PayloadSizes(_ReadingEnd):
    """Payloads of 0 bytes to 10 MiB."""

    def left(self) -> Observation:
        publisher = self.publisher("size", priority=zenoh.Priority.DATA)
        self.meet()
        self.matched(publisher)
        for size in _SIZES:
            publisher.put(bytes(range(256)) * (size // 256) + bytes(size % 256))
        self.finish()


@scenario(
    "put_delete", limits={"intercepted": "the forwarding session stamps deletes as well, which a router does not"}
)
class _PutDelete(_ReadingEnd):
    """Puts and deletes of the session and of a publisher, in order."""

    def left(self) -> Observation:
        publisher = self.publisher("declared")
        self.meet()
        self.matched(publisher)
        self.put("x", "1")
        self.session.delete(self.key("x"), congestion_control=BLOCK)
        self.session.delete(self.key("x"), congestion_control=BLOCK, attachment=b"why")
        publisher.put("2")
        publisher.delete(attachment=b"\x00\xff")
        self.put("x", b"\xff\x00")
        self.finish()


@scenario("encodings")
class _Encodings(_ReadingEnd):
    """Known encodings, schemas, and encodings of one's own."""

    def left(self) -> Observation:
        self.meet()
        for encoding in _ENCODINGS:
            self.put("e", "x", encoding=encoding)
        self.finish()


@scenario("attachments")
class _Attachments(_ReadingEnd):
    """No attachment, an empty one, text, all bytes, and a large one."""

    def left(self) -> Observation:
        self.meet()
        for attachment in (None, b"", b"text", bytes(range(256)), bytes(1 << 16)):
            self.put("a", "x", attachment=attachment)
        self.finish()
