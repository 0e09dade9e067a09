"""The JSON mirror, on a bus that is a list."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable

from riot_bus_bridges.mavlink.json_form import JsonForm
from riot_bus_bridges.mavlink.mirror import ENCODING, Mirror
from riot_bus_bridges.mavlink.sequences import OwnStreams
from riot_bus_mavlink.frame import Frame
from tests.unit.riot_bus_bridges.mavlink.frames import COMMON, frame_of, unknown_frame

WAIT_S = 20.0
BODY = '{"header": {"system_id": 9, "component_id": 8}, "message": {"type": "HEARTBEAT", "custom_mode": %d}}'


class Port:
    """A segment that keeps what is published, while it may."""

    endpoint = "here"

    def __init__(self) -> None:
        self.puts: dict[str, list[bytes]] = {}
        self.go, self.bell = threading.Event(), threading.Event()
        self.takes: dict[str, Callable[[bytes, bytes | None], None]] = {}
        self.closed = 0

    def publisher(
        self, key: str, *, reliable: bool, changed: Callable[[], None] | None = None, encoding: str = ""
    ) -> Outlet:
        assert (reliable, encoding) == (True, ENCODING)
        return Outlet(self, key)

    def subscribe(self, key: str, take: Callable[[bytes, bytes | None], None]) -> Inlet:
        self.takes[key] = take
        return Inlet()

    collect = subscribe


class Inlet:
    def close(self) -> None:
        pass


class Outlet:
    def __init__(self, port: Port, key: str) -> None:
        self._port, self._key = port, key

    def put(self, payload: bytes, attachment: bytes) -> None:
        self._port.bell.set()
        assert self._port.go.wait(WAIT_S)
        self._port.puts.setdefault(self._key, []).append(payload)

    def matched(self) -> bool:
        return False

    def close(self) -> None:
        self._port.closed += 1


def mirror_on(port: Port, *, fields: bool = False, insert: Callable[[Frame], None] | None = None) -> Mirror:
    return Mirror(port, JsonForm(COMMON), fields=fields, streams=OwnStreams(COMMON.crc_extra), insert=insert)


def test_messages_and_fields_are_published() -> None:
    port = Port()
    port.go.set()
    mirror = mirror_on(port, fields=True)
    mirror.open()
    mirror.offer([frame_of("SYSTEM_TIME", source=(3, 4), time_boot_ms=7).raw, unknown_frame().raw])
    mirror.offer([frame_of("SYSTEM_TIME", source=(3, 4), time_boot_ms=8).raw])
    while mirror.counts["mirrored"] < 2:
        port.bell.wait(0.001)
    mirror.close()
    assert sorted(port.puts) == [
        "mavlink/3/4/SYSTEM_TIME",
        "mavlink/3/4/SYSTEM_TIME/time_boot_ms",
        "mavlink/3/4/SYSTEM_TIME/time_unix_usec",
        "mavlink/3/4/SYSTEM_TIME/type",
        "mavlink/out",
    ]
    assert port.puts["mavlink/3/4/SYSTEM_TIME/time_boot_ms"] == [b"7", b"8"]
    assert port.puts["mavlink/3/4/SYSTEM_TIME/type"] == [b'"SYSTEM_TIME"'] * 2
    assert [json.loads(each)["message"]["time_boot_ms"] for each in port.puts["mavlink/out"]] == [7, 8]
    assert port.closed == 5


def test_what_it_has_no_time_for_is_counted() -> None:
    port = Port()
    mirror = mirror_on(port)
    mirror.open()
    frames = [frame_of().raw, frame_of().raw]
    mirror.offer(frames)
    assert port.bell.wait(WAIT_S)  # the first of them is being published
    for _ in range(1024 + 5):
        mirror.offer(frames)
    assert mirror.counts["mirror_lost"] == 5 * 2
    port.go.set()
    mirror.close()
    assert mirror.counts["mirrored"] <= 2 * 1025


def test_what_others_send_is_numbered_and_what_is_no_message_refused() -> None:
    port, came = Port(), list[Frame]()
    port.go.set()
    mirror = mirror_on(port, insert=came.append)
    mirror.open()
    take = port.takes["mavlink/in"]
    for payload in ((BODY % 1).encode(), b"\xff\xfe", b"[]", (BODY % 2).encode(), b"{" * 100_000):
        take(payload, None)
    mirror.close()
    assert [(frame.system, frame.component, frame.sequence, frame.payload[0]) for frame in came] == [
        (9, 8, 0, 1),
        (9, 8, 1, 2),
    ]
    assert mirror.counts == {"json_in": 2, "json_refused": 3}
