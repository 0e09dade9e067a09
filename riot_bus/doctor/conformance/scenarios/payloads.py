"""Contents of a sample: payload, kind, encoding and attachment."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.doctor.conformance.helpers import (
    everything,
    finish,
    put,
)
from riot_bus.doctor.conformance.scenario import Observation, scenario

if TYPE_CHECKING:
    from riot_bus.doctor.conformance.end import ScenarioEnd

_SIZES = (0, 1, 1 << 16, 10 << 20)  # none, one byte, one more than a batch of Zenoh, 160 batches


@scenario("payload_sizes")
class _PayloadSizes:
    """Payloads of 0 bytes to 10 MiB."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh

        publisher = end.session.declare_publisher(
            end.key("size"), congestion_control=zenoh.CongestionControl.BLOCK, priority=zenoh.Priority.DATA
        )
        end.meet()
        end.matched(publisher)
        for size in _SIZES:
            publisher.put(bytes(range(256)) * (size // 256) + bytes(size % 256))
        finish(end)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        return everything(end)


@scenario(
    "put_delete", limits={"intercepted": "the forwarding session stamps deletes as well, which a router does not"}
)
class _PutDelete:
    """Puts and deletes of the session and of a publisher, in order."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh

        block = zenoh.CongestionControl.BLOCK
        publisher = end.session.declare_publisher(end.key("declared"), congestion_control=block)
        end.meet()
        end.matched(publisher)
        put(end, "x", "1")
        end.session.delete(end.key("x"), congestion_control=block)
        end.session.delete(end.key("x"), congestion_control=block, attachment=b"why")
        publisher.put("2")
        publisher.delete(attachment=b"\x00\xff")
        put(end, "x", b"\xff\x00")
        finish(end)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        return everything(end)


@scenario("encodings")
class _Encodings:
    """Known encodings, schemas, and encodings of one's own."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        from riot_bus.zenoh import api as zenoh

        end.meet()
        for encoding in (
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
        ):
            put(end, "e", "x", encoding=encoding)
        put(end, "e", "x", encoding=zenoh.Encoding.APPLICATION_PROTOBUF.with_schema("a.B"))
        finish(end)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        return everything(end)


@scenario("attachments")
class _Attachments:
    """No attachment, an empty one, text, all bytes, and a large one."""

    @staticmethod
    def left(end: ScenarioEnd) -> Observation:
        end.meet()
        for attachment in (None, b"", b"text", bytes(range(256)), bytes(1 << 16)):
            put(end, "a", "x", attachment=attachment)
        finish(end)

    @staticmethod
    def right(end: ScenarioEnd) -> Observation:
        return everything(end)
