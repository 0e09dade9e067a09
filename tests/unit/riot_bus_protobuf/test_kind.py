from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from riot_bus.types.payloads import Payloads
from riot_bus.vocabulary.errors import PayloadError
from riot_bus_protobuf.kind import ProtobufType
from riot_bus_protobuf.layout import Definitions
from tests.unit.types.proto_samples import SET, cls

DEFINITIONS = Definitions({file.name: file for file in SET.file})
EVERY = ProtobufType("test.Every", DEFINITIONS)
EDITION = ProtobufType("new.Edition", DEFINITIONS)
LEGACY = ProtobufType("old.Legacy", DEFINITIONS)
EMPTY = b""


def every(data: bytes) -> Any:
    return cls("test.Every").FromString(data)  # type: ignore[no-untyped-call]


def made(**values: Any) -> bytes:
    return bytes(cls("test.Every")(**values).SerializeToString())  # type: ignore[no-untyped-call]


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("f_int32", -7),
        ("f_string", "né"),
        ("at.z", 2.5),
        ("inner.inner.at.x", 1.0),
        ("number", 9),
        ("maybe", 0),
    ],
)
def test_what_is_not_on_the_wire_is_added_with_all_around_it(path: str, value: Any) -> None:
    data = EVERY.rebuild(EMPTY, {path: value})
    assert EVERY.read(data, path) == value
    found = every(data)
    for name in path.split("."):
        found = getattr(found, name)
    assert found == value


def test_several_new_fields_of_one_new_message_are_merged_by_readers() -> None:
    at = every(EVERY.rebuild(EMPTY, {"at.x": 1.0, "at.y": 2.0})).at
    assert (at.x, at.y) == (1.0, 2.0)


@pytest.mark.parametrize("path", ["maybe", "number", "at.x", "inner.f_int32"])
def test_only_fields_with_presence_may_be_absent(path: str) -> None:
    with pytest.raises(PayloadError, match="this field is not set"):
        EVERY.read(EMPTY, path)
    assert (EVERY.read(EMPTY, "f_int32"), EVERY.read(EMPTY, "len(path)")) == (0, 0)


@pytest.mark.parametrize("count", [0, 1, 3, 200])
@pytest.mark.parametrize("name", ["r_int32", "r_double", "r_string", "unpacked", "path"])
def test_arrays_grow_by_what_is_last_and_shrink_from_the_end(name: str, count: int) -> None:
    values: dict[str, list[Any]] = {
        "r_int32": [1, -2], "r_double": [1.0, 2.0], "r_string": ["a", "bb"], "unpacked": [1, 300],
        "path": [{"x": 1.0}, {"y": 2.0}],
    }  # fmt: skip
    given = values[name]
    data = EVERY.rebuild(made(**{name: given}), {f"len({name})": count})
    assert every(data) == cls("test.Every")(**{name: (given + given[-1:] * count)[:count]})  # type: ignore[no-untyped-call]
    grown = every(EVERY.rebuild(EMPTY, {f"len({name})": count}))
    assert len(getattr(grown, name)) == count


def test_lengths_around_a_change_grow_with_it() -> None:
    data = made(inner={"inner": {"f_string": "x"}})
    changed = EVERY.rebuild(data, {"inner.inner.f_string": "y" * 200})
    assert every(changed).inner.inner.f_string == "y" * 200
    with pytest.raises(PayloadError, match="different number of bytes"):
        EVERY.patch(data, {"inner.inner.f_string": "yy"})
    assert EVERY.patch(data, {"inner.inner.f_string": "z"}) == data.replace(b"x", b"z")


def test_groups_are_made_as_groups() -> None:
    data = LEGACY.rebuild(EMPTY, {"part.x": 1.5, "len(parts)": 2})
    found = cls("old.Legacy").FromString(data + b"\x08\1")  # type: ignore[no-untyped-call]
    assert (found.part.x, len(found.parts)) == (1.5, 2)
    delimited = cls("new.Edition").FromString(EDITION.rebuild(EMPTY, {"delimited.y": 2.0}))  # type: ignore[no-untyped-call]
    assert delimited.delimited.y == 2.0


def test_arrays_are_read_as_a_whole_and_in_bulk() -> None:
    parts = [made(r_int32=[1, -2]), b"\xff", EMPTY]
    lengths = np.array([len(each) for each in parts])
    payloads = Payloads(b"".join(parts), np.cumsum(lengths) - lengths, lengths)
    assert [each.tolist() for each in EVERY.elements(payloads, "r_int32")] == [[1, -2], []]
    assert EVERY.array(made(r_string=["a", "b"]), "r_string") == ["a", "b"]
    with pytest.raises(PayloadError, match="no such array of numbers"):
        EVERY.elements(payloads, "r_string")
    with pytest.raises(PayloadError, match="elements of this array are messages"):
        EVERY.array(EMPTY, "path")


def test_entries_of_maps_are_members() -> None:
    data = made(counts={"left": 1, "odd key": 300})
    assert [EVERY.read(data, path) for path in ("counts.left", 'counts["odd key"]')] == [1, 300]
    changed = EVERY.rebuild(data, {'counts["odd key"]': 1 << 20})
    assert dict(every(changed).counts) == {"left": 1, "odd key": 1 << 20}
    with pytest.raises(PayloadError, match="no entry 'lift'") as error:
        EVERY.read(data, "counts.lift")
    assert (error.value.where, "left" in str(error.value.hint)) == ("test.Every: counts.lift", True)


def test_a_type_that_is_not_defined() -> None:
    with pytest.raises(KeyError):
        ProtobufType("test.Nothing", DEFINITIONS)
