"""The JSON mirror, on a bus that is a list."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_bridges.mavlink.mirror import ENCODING, JsonForm, Mirror
from riot_bus_bridges.mavlink.sequences import OwnStreams
from riot_bus_mavlink.dialect import load_dialect
from riot_bus_mavlink.frame import Frame, pack_frame, parse_frame, trimmed
from tests.tiers import folded
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


ALL = load_dialect("all")
FORM = JsonForm(ALL)


def zero(system: int, component: int) -> int:
    return 0


def test_the_form_of_mavlink2rest() -> None:
    heartbeat = frame_of(sequence=7, type=6, autopilot=8, base_mode=81, system_status=4, mavlink_version=3)
    assert FORM.document(heartbeat) == {
        "header": {"system_id": 1, "component_id": 1, "sequence": 7, "message_id": 0},
        "message": {
            "type": "HEARTBEAT",
            "mavtype": {"type": "MAV_TYPE_GCS"},
            "autopilot": {"type": "MAV_AUTOPILOT_INVALID"},
            "base_mode": {"bits": 81},
            "custom_mode": 0,
            "system_status": {"type": "MAV_STATE_ACTIVE"},
            "mavlink_version": 3,
        },
    }
    value = FORM.document(frame_of("PARAM_VALUE", param_id="SYSID_THISMAV", param_value=1.5, param_count=9))
    assert value is not None
    assert value["message"]["param_id"] == "SYSID_THISMAV"
    assert value["message"]["param_value"] == 1.5
    undefined = FORM.document(frame_of(type=250))
    assert undefined is not None
    assert undefined["message"]["mavtype"] == 250
    assert FORM.document(unknown_frame()) is None


@folded("message", ALL.messages.values(), by=lambda each: each.name[0], name=lambda each: each.name)
def test_every_message_comes_back(message: Any) -> None:
    payload = bytes((7 * place + 65) % 90 + 1 for place in range(message.size))
    raw = pack_frame(message.id, payload, message.crc_extra, version=2, sequence=0, system=3, component=4)
    document = FORM.document(parse_frame(raw))
    assert document is not None
    assert FORM.frame(json.dumps(document).encode(), zero).raw == raw


@settings(deadline=None)
@given(st.data())
def test_any_payload_comes_back(data: st.DataObject) -> None:
    message = data.draw(st.sampled_from(list(ALL.messages.values())))
    payload = data.draw(st.binary(min_size=message.size, max_size=message.size))
    frame = parse_frame(
        pack_frame(message.id, payload, message.crc_extra, version=2, sequence=0, system=3, component=4)
    )
    document = FORM.document(frame)
    assert document is not None
    assume_text = any(place.field.type == "char" for place in message.places.values())
    if assume_text or _has_nan(document):
        assert FORM.document(FORM.frame(json.dumps(document).encode(), zero)) is not None
    else:
        assert FORM.frame(json.dumps(document).encode(), zero).payload == trimmed(payload)


def _has_nan(value: Any) -> bool:
    if isinstance(value, dict):
        return any(map(_has_nan, value.values()))
    return any(map(_has_nan, value)) if isinstance(value, list) else isinstance(value, float) and math.isnan(value)


def test_other_spellings_are_taken() -> None:
    text = {"type": "NAMED_VALUE_FLOAT", "time_boot_ms": 0, "value": 2.0, "name": ["l", "e", "a", "k", "\0", "\0"]}
    frame = FORM.frame(json.dumps({"header": {"system_id": 255, "component_id": 0}, "message": text}).encode(), zero)
    assert frame.payload.endswith(b"leak")
    text["name"] = [108, 101, 97, 107]
    again = FORM.frame(json.dumps({"header": {"system_id": 255, "component_id": 0}, "message": text}).encode(), zero)
    assert again == frame
    empty = b'{"header": {"system_id": 1, "component_id": 2, "sequence": 9}, "message": {"type": "HEARTBEAT"}}'
    numbered = FORM.frame(empty, lambda system, component: 10 * system + component)
    assert (numbered.sequence, numbered.payload) == (12, b"\0")


HEADER = '"header": {"system_id": 1, "component_id": 2}'


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "not JSON"),
        ("[" * 50_000, "not JSON"),
        ("[]", "is expected"),
        ('{"header": {}, "message": []}', "is expected"),
        ('{"header": {"system_id": 256, "component_id": 0}, "message": {"type": "HEARTBEAT"}}', "not an id"),
        ('{"header": {"system_id": true, "component_id": 0}, "message": {"type": "HEARTBEAT"}}', "not an id"),
        (f'{{{HEADER}, "message": {{}}}}', "unknown message"),
        (f'{{{HEADER}, "message": {{"type": "HEARTBEET"}}}}', "HEARTBEAT"),
        (f'{{{HEADER}, "message": {{"type": "HEARTBEAT", "mavtyp": 1}}}}', "did you mean 'mavtype'"),
        (f'{{{HEADER}, "message": {{"type": "HEARTBEAT", "mavtype": {{"type": "MAV_TYPE_GC"}}}}}}', "MAV_TYPE_GCS"),
        (f'{{{HEADER}, "message": {{"type": "HEARTBEAT", "base_mode": "x"}}}}', "not a number"),
        (f'{{{HEADER}, "message": {{"type": "HEARTBEAT", "custom_mode": 1{"0" * 400}}}}}', "out of range"),
        (f'{{{HEADER}, "message": {{"type": "HEARTBEAT", "custom_mode": NaN}}}}', "not of type uint32"),
        (f'{{{HEADER}, "message": {{"type": "STATUSTEXT", "text": 4}}}}', "not text"),
        (f'{{{HEADER}, "message": {{"type": "STATUSTEXT", "text": [-1]}}}}', "not text"),
        (f'{{{HEADER}, "message": {{"type": "GPS_STATUS", "satellite_prn": {list(range(21))}}}}}', "at most 20"),
        ('{"header": {}, "message": {"x": "' + "y" * 70_000 + '"}}', "too much"),
    ],
)
def test_what_is_wrong_is_refused(text: str, part: str) -> None:
    with pytest.raises(PayloadError) as error:
        FORM.frame(text.encode(), zero)
    assert part in str(error.value)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=12), inner, max_size=4),
    max_leaves=12,
)


@given(
    st.one_of(
        st.binary(max_size=200),
        JSON.map(lambda value: json.dumps(value).encode()),
        st.builds(
            lambda name, key, value: json.dumps(
                {"header": {"system_id": 1, "component_id": 1}, "message": {"type": name, key: value}}
            ).encode(),
            st.sampled_from(["HEARTBEAT", "STATUSTEXT", "PARAM_SET", "GPS_STATUS"]),
            st.sampled_from(["mavtype", "base_mode", "text", "param_id", "param_value", "satellite_prn", "severity"]),
            JSON,
        ),
    )
)
def test_any_bytes_are_a_frame_or_refused(payload: bytes) -> None:
    try:
        frame = FORM.frame(payload, zero)
    except PayloadError:
        return
    assert FORM.document(frame) is not None
