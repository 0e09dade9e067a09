from __future__ import annotations

import math

import msgpack  # type: ignore[import-untyped]
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.log.engine.limits import BeyondLimitError, LogLimits
from riot_bus.log.layout import (
    Constants,
    Provenance,
    apply_extras,
    channel_name,
    companions,
    extras_of,
    pack_extras,
    pack_provenance,
    unpack_extras,
    unpack_provenance,
)
from riot_bus.pipeline.event import Change
from riot_bus.types.serve import Request
from riot_bus.vocabulary.message import Message, Qos

PLAIN = Constants()


@settings(deadline=None)
@given(
    attachment=st.none() | st.binary(max_size=9),
    encoding=st.sampled_from(["", "text/json"]),
    kind=st.sampled_from(["put", "delete"]),
    qos=st.builds(Qos, st.integers(1, 7), st.sampled_from(["drop", "block"]), st.booleans()),
    sequence=st.integers(0, 1 << 70),
    published=st.none() | st.integers(-(1 << 65), 1 << 65),
)
def test_what_neither_message_nor_channel_holds_comes_back(
    attachment, encoding, kind, qos, sequence, published
) -> None:  # type: ignore[no-untyped-def]
    message = Message(5, "k", b"", kind, encoding, attachment, qos, "s", sequence, published)
    extras = extras_of(message, PLAIN)
    fields = {
        "encoding": "",
        "segment": "",
        "qos": Qos(),
        "sequence": sequence & 0xFFFFFFFF,
        "publish_time": None if published == 5 or published is None else published & 0xFFFFFFFFFFFFFFFF,
    }
    apply_extras(fields, extras or {})
    assert Message(5, "k", b"", **fields) == message  # type: ignore[arg-type]


def test_what_channels_say_and_damaged_extras_are_left_alone() -> None:
    constants = Constants("text/json", "s", Qos(1, "block", express=True))
    assert Constants.from_metadata(constants.to_metadata()) == constants
    assert Constants.from_metadata({"riot.qos": "[[["}) == PLAIN
    assert extras_of(Message(1, "k", b""), PLAIN) is None
    assert extras_of(Request(1, "k", b"", parameters="p"), PLAIN) == {"r": "p"}
    fields: dict[str, object] = {}
    apply_extras(fields, {"a": "text", "n": "1", "p": "x", "d": 1, "q": ["?"], "unknown": 1})
    assert fields == {"qos": Qos()}


def test_channels_of_calls_and_originals_have_names_of_their_own() -> None:
    assert channel_name("/add/@reply", "original") == "riot/original/riot/reply/add"
    assert channel_name("/odom", "original") == "riot/original/odom"
    assert channel_name("/odom", "delivered") == "/odom"


def test_extras_of_a_chunk() -> None:
    extras = [(0, {"a": b"x"}), (3, {"n": 1 << 40})]
    assert unpack_extras(pack_extras(extras), 4) == dict(extras)
    many = [(place, {"a": b"x"}) for place in range(40_000)]
    assert unpack_extras(pack_extras(many), 40_000) == dict(many)
    assert companions([], []).extras == b""
    assert companions(extras, []).note is None


@pytest.mark.parametrize(
    "data",
    [
        b"",
        zstandard.compress(b"\xc1"),
        zstandard.compress(msgpack.packb([[0, {"a": 1}], [1, {}], [2, {}], [3, {}], [4, {}]])),
        zstandard.compress(msgpack.packb([1, 2])),
        zstandard.compress(msgpack.packb([[0, {"a": {"b": {}}}]] * 40_000)),
        zstandard.compress(msgpack.packb([[0, [0, 1]]] * 40_000)),
    ],
)
def test_damaged_extras(data: bytes) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 - each of them says something else
        unpack_extras(data, 4 if len(data) < 60 else 40_000)


def test_extras_beyond_the_limits() -> None:
    with pytest.raises(BeyondLimitError):
        unpack_extras(pack_extras([(0, {"a": bytes(1000)})]), 1, LogLimits(chunk=100))


def test_provenance_keeps_values_that_json_lacks() -> None:
    values = (float("nan"), math.inf, b"\xff", "a\nb\ud800", 1.5, 2, True, None, "x")
    entry = Provenance(1, "k", 2, "original", tuple(Change("set", "set", "f", each, each) for each in values))
    (found,) = unpack_provenance(pack_provenance([entry]))
    assert repr(found) == repr(entry)


@pytest.mark.parametrize("text", ["", "[1]", '[{"sequence": 1}]', "[" * 100_000, '[{"sequence": 1e999}]'])
def test_damaged_provenance(text: str) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 - each of them says something else
        unpack_provenance(text)
