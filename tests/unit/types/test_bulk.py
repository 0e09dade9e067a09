"""Fields of many payloads at once are those that are read one by one, whatever the type."""

import json

import msgpack
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from riot_bus.types.bulk import as_array, gather, join
from riot_bus.types.json_type import JsonType
from riot_bus.types.msgpack_type import MsgpackType
from riot_bus.types.payloads import Gathered, Payloads
from riot_bus.vocabulary.errors import PayloadError

BUSY = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])  # as machines may be
SCALARS = st.booleans() | st.integers(-(1 << 66), 1 << 66) | st.floats() | st.text(max_size=5)
MAYBE = st.lists(SCALARS | st.none(), max_size=12)


def payloads_of(bodies, *, before=b"junk", between=b"--"):
    """Put payloads into one buffer, with other things around them."""
    buffer, offsets = bytearray(before), []
    for body in bodies:
        offsets.append(len(buffer))
        buffer += body + between
    lengths = [len(body) for body in bodies]
    return Payloads(bytes(buffer), np.array(offsets, np.int64), np.array(lengths, np.int64))


def same(one, other):
    return type(one) is type(other) and (one == other or (one != one and other != other))


def listed(found):
    assert len(found.values) == len(found.valid)
    return [value if valid else None for value, valid in zip(found.values.tolist(), found.valid.tolist(), strict=True)]


def read_or_none(kind, payload, path):
    try:
        return kind.read(payload, path)
    except PayloadError:
        return None


@BUSY
@given(st.lists(st.binary(max_size=9), max_size=9))
def test_payloads_are_what_was_put_in(bodies):
    payloads = payloads_of(bodies)
    assert list(payloads) == bodies
    assert len(payloads) == len(bodies)
    mask = np.arange(len(bodies)) % 2 == 0
    assert list(payloads.take(mask)) == bodies[::2]


@BUSY
@given(MAYBE)
def test_arrays_hold_scalars_exactly(values):
    found = as_array(values)
    for value, kept in zip(values, listed(found), strict=True):
        if value is None:
            assert kept is None
        elif isinstance(value, int) and isinstance(kept, float):
            assert int(kept) == value
        else:
            assert same(kept, value)


@BUSY
@given(st.lists(MAYBE, max_size=4))
def test_joined_arrays_hold_all_values_exactly(parts):
    found = join([as_array(part) for part in parts])
    values = [value for part in parts for value in part]
    for value, kept in zip(values, listed(found), strict=True):
        if value is None:
            assert kept is None
        elif isinstance(kept, float) and not isinstance(value, float):
            assert kept == value
        else:
            assert same(kept, value)


@pytest.mark.parametrize(
    ("values", "dtype"),
    [
        ([True, False], "bool"),
        ([1, None], "int64"),
        ([1 << 63], "uint64"),
        ([-1, 1 << 63], "object"),
        ([1 << 70], "object"),
        ([1, 2.5], "float64"),
        ([(1 << 53) + 1, 2.5], "object"),
        (["a", None], "object"),
        ([b"a", 1], "object"),
        ([True, 1], "object"),
        ([None], "float64"),
        ([], "float64"),
    ],
)
def test_types_of_arrays(values, dtype):
    assert as_array(values).values.dtype == dtype


def test_nothing_is_nan_zero_or_none():
    assert np.isnan(as_array([None, 1.0]).values[0])
    assert as_array([None, 1]).values[0] == 0
    assert as_array([None, "a"]).values[0] is None


@pytest.mark.parametrize(
    ("one", "other", "dtype"),
    [
        ("float32", "float64", "float64"),
        ("uint8", "int16", "int16"),
        ("int64", "uint64", "object"),
        ("bool", "int8", "object"),
        ("float64", "object", "object"),
    ],
)
def test_joined_types(one, other, dtype):
    parts = [Gathered(np.ones(1, each), np.ones(1, np.bool_)) for each in (one, other)]
    if (one, other) == ("int64", "uint64"):
        parts[1].values[0] = (1 << 64) - 1
    joined = join(parts)
    assert joined.values.dtype == dtype
    assert joined.values.tolist() == [part.values.tolist()[0] for part in parts]


def test_parts_without_values_do_not_decide_the_type():
    nothing = Gathered(np.full(2, np.nan), np.zeros(2, np.bool_))
    some = Gathered(np.array([1, 2], np.uint8), np.ones(2, np.bool_))
    joined = join([nothing, some])
    assert joined.values.dtype == np.uint8
    assert listed(joined) == [None, None, 1, 2]


DOCUMENTS = st.lists(st.fixed_dictionaries({}, optional={"a": SCALARS | st.none(), "b": st.lists(st.floats())}))


@BUSY
@given(DOCUMENTS, st.sampled_from(["a", "b", "len(b)", "b[0]", "c", "a.b"]))
def test_json_and_msgpack_are_read_one_by_one(documents, path):
    for kind, bodies in (
        (JsonType(), [json.dumps(each).encode() for each in documents]),
        (MsgpackType(), [msgpack.packb(each) for each in documents if type(each.get("a")) is not int]),
    ):
        bodies = [*bodies, b"\xc1 neither", b""]
        found = gather(kind, payloads_of(bodies), path)
        for body, kept in zip(bodies, listed(found), strict=True):
            value = read_or_none(kind, body, path)
            assert same(kept, value) or (isinstance(kept, float) and kept == value)


class Doubtful:
    """A type that finds half of its values in bulk."""

    def gather(self, payloads, path):
        values = np.array([len(payload) for payload in payloads], np.int64)
        doubtful = values % 2 == 1
        return Gathered(np.where(doubtful, 0, values), ~doubtful, doubtful)

    def read(self, payload, path):
        if len(payload) == 3:
            raise PayloadError("no field")
        return len(payload)


def test_what_is_doubtful_in_bulk_is_read_one_by_one():
    found = gather(Doubtful(), payloads_of([b"", b"a", b"ab", b"abc"]), "size")
    assert listed(found) == [0, 1, 2, None]
