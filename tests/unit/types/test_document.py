from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cbor2
import msgpack
import pytest

from riot_bus.types.cbor_type import CborType
from riot_bus.types.document import INDEFINITE, Code, DocumentType
from riot_bus.types.model import Leaf
from riot_bus.types.msgpack_type import MsgpackType
from riot_bus.vocabulary.errors import PayloadError

DOCUMENT = {"a": {"b": [1, 2, 3], "t": "text", 7: False}, "x": 1.5, "none": None}
BOTH = pytest.mark.parametrize(
    ("kind", "dumps", "loads"),
    [(MsgpackType(), msgpack.dumps, lambda data: msgpack.loads(data, strict_map_key=False)),
     (CborType(), cbor2.dumps, cbor2.loads)],
    ids=["msgpack", "cbor"],
)  # fmt: skip
Dumps = Callable[[Any], bytes]
Loads = Callable[[bytes], Any]


class Tiny(DocumentType):
    """Bytes below 0x10 are themselves; arrays and maps end with a break."""

    title = "Tiny"
    codes = (
        *(Code("uint", number=number) for number in range(0x10)),
        Code("array", number=INDEFINITE), Code("map", number=INDEFINITE), Code("uint", 1), Code("tag", 1),
        *[Code("")] * (256 - 0x14),
    )  # fmt: skip
    signed = False


def test_codes_are_all_that_an_encoding_defines() -> None:
    tiny = Tiny()
    payload = b"\x11\x03\x10\x01\x13\xaa\x02\xff\x04\x05\xff"  # {3: [1, tag 2], 4: 5}
    assert tiny.leaves(payload) == [
        Leaf("len([3])", "uint32", 2),
        Leaf("[3][0]", "int64", 1),
        Leaf("[3][1]", "int64", 2),
        Leaf("[4]", "int64", 5),
    ]
    assert tiny.patch(payload, {"[3][1]": 9, "[4]": 7}) == b"\x11\x03\x10\x01\x13\xaa\x09\xff\x04\x07\xff"
    assert tiny.patch(payload, {"[4]": 255}) == payload[:-2] + b"\x12\xff\xff"
    assert tiny.rebuild(payload, {"len([3])": 4}) == b"\x11\x03\x10\x01" + 3 * b"\x13\xaa\x02" + b"\xff\x04\x05\xff"
    with pytest.raises(PayloadError, match="too much for one Tiny item"):
        tiny.patch(payload, {"[4]": 256})


@pytest.mark.parametrize(
    "payload", [b"", b"\x10", b"\x10\x01", b"\x11\x01\xff", b"\x13\xaa", b"\x99", b"\x13\xaa" * 99]
)
def test_incomplete_items_are_opaque(payload: bytes) -> None:
    assert Tiny().opaque(payload)


@BOTH
def test_both_encodings_have_the_same_fields(kind: DocumentType, dumps: Dumps, loads: Loads) -> None:
    found = {leaf.path: leaf.value for leaf in kind.leaves(dumps(DOCUMENT))}
    assert found == {"len(a.b)": 3, "a.b[0]": 1, "a.b[1]": 2, "a.b[2]": 3, "a.t": "text", "a[7]": False, "x": 1.5}
    assert {path: kind.read(dumps(DOCUMENT), path) for path in found} == found


@BOTH
@pytest.mark.parametrize("path", ["a", "x", "none", "a.t"])
def test_any_entry_of_a_map_can_be_left_out(kind: DocumentType, dumps: Dumps, loads: Loads, path: str) -> None:
    expected: dict[Any, Any] = {**DOCUMENT, "a": {**DOCUMENT["a"]}}  # type: ignore[dict-item]
    del (expected["a"] if path == "a.t" else expected)[path.removeprefix("a.")]
    assert loads(kind.omit(dumps(DOCUMENT), path)) == expected


@BOTH
@pytest.mark.parametrize(("instead", "value"), [("null", None), ("list", []), ("map", {})])
def test_anything_can_be_replaced(kind: DocumentType, dumps: Dumps, loads: Loads, instead: Any, value: object) -> None:
    assert loads(kind.omit(dumps(DOCUMENT), "a.b[1]", instead=instead))["a"]["b"] == [1, value, 3]
    assert loads(kind.omit(dumps(DOCUMENT), "a", instead=instead))["a"] == value


@BOTH
def test_elements_cannot_be_left_out_nor_lengths(kind: DocumentType, dumps: Dumps, loads: Loads) -> None:
    for path, message in (("a.b[1]", "only entries of a map"), ("len(a.b)", "cannot be left out"), ("y", "no field")):
        with pytest.raises(PayloadError, match=message):
            kind.omit(dumps(DOCUMENT), path)


@BOTH
@pytest.mark.parametrize("count", [0, 1, 3, 40])
def test_lengths_and_elements_change_together(kind: DocumentType, dumps: Dumps, loads: Loads, count: int) -> None:
    changes: dict[str, Any] = {"a.b[2]": 5, "len(a.b)": count} if count > 2 else {"len(a.b)": count}
    wanted = [1, 2, 5, *[3] * 37][:count] if count > 2 else [1, 2, 3][:count]
    assert loads(kind.rebuild(dumps(DOCUMENT), changes))["a"]["b"] == wanted
