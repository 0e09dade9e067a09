from __future__ import annotations

import json
import struct
from collections.abc import Callable

import msgpack  # type: ignore[import-untyped]
import pytest

from riot_bus.draft.model import TopicDraft
from riot_bus.draft.recording import look_at
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message


def look(payload: Callable[[int], bytes], *, encoding: str = "", declared: dict[str, str] | None = None) -> TopicDraft:
    messages = [Message(number * 10**8, "k", payload(number), encoding=encoding) for number in range(5)]
    found, skipped = look_at(messages, TypeRegistry(declared=declared))
    assert skipped == 0
    return found["k"]


@pytest.mark.parametrize(
    ("payload", "encoding", "type_name", "declare", "fits"),
    [
        (lambda n: json.dumps({"x": n}).encode(), "application/json", "json", False, ()),
        (lambda n: json.dumps([n]).encode(), "", "json", False, ()),
        (lambda n: msgpack.packb({"x": n}), "", "msgpack", False, ()),
        (lambda n: b"\xa1\x61x" + bytes([n]), "", "cbor", True, ()),  # which nothing infers
        (lambda n: msgpack.packb({"x": n}), "application/json", "msgpack", True, ()),  # the encoding is wrong
        (lambda n: b"%d.5" % n, "zenoh/string", "json", True, ()),  # text is clear
        (lambda n: b"%d" % n, "", "", False, ("cbor", "json", "msgpack")),  # a digit is a number everywhere
        (lambda n: msgpack.packb(n + 0.5), "", "", False, ("msgpack",)),  # so is a byte that may be anything
        (lambda n: struct.pack("<Qf", n * 77777, 0.5), "", "", False, ()),
        (lambda n: b"hello" if n else b"{}", "", "", False, ()),
        (lambda n: b"\x08\x01", "application/protobuf;a.B", "", False, ()),
    ],
)
def test_codecs_that_read_all_payloads(
    payload: Callable[[int], bytes], encoding: str, type_name: str, declare: bool, fits: tuple[str, ...]
) -> None:
    found = look(payload, encoding=encoding)
    assert (found.type_name, found.declare, found.fits) == (type_name, declare, fits)


def test_counts_rates_sizes_and_encodings() -> None:
    found = look(lambda n: b"x" * n, encoding="text/plain")
    assert (found.count, found.rate, found.sizes, found.encodings) == (5, pytest.approx(10.0), (0, 4), ("text/plain",))
    (one,) = look_at([Message(1, "k", b"")], TypeRegistry())[0].values()
    assert (one.count, one.rate) == (1, 0.0)


def test_what_is_declared_counts() -> None:
    assert look(lambda n: struct.pack("<I", n), declared={"k": "raw(uint32 n)"}).type_name == "raw(uint32 n)"


def test_keys_beyond_all_measure_are_counted() -> None:
    found, skipped = look_at((Message(1, f"k/{number}", b"") for number in range(2500)), TypeRegistry())
    assert (len(found), skipped) == (2000, 500)
