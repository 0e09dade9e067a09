"""Records are found at once as they are found one by one."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.log.engine.blocks import records_of
from tests.log_mutants import channel, message, record

LENGTHS = st.lists(st.tuples(st.integers(0, 40), st.integers(1, 120)), max_size=8)


def one_by_one(data):
    messages, others, position = [], [], 0
    while position + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, position)
        following = position + 9 + length
        if following > len(data) or not opcode or (opcode == 5 and length < 22):
            break
        if opcode == 5:
            messages.append(position)
        else:
            others.append((opcode, position + 9, following))
        position = following
    return messages, others, position


@settings(deadline=None)
@given(LENGTHS, st.integers(0, 60), st.booleans())
def test_records(runs, cut, definitions):
    data = b""
    for length, count in runs:
        data += channel(1, "/a", 0) if definitions else b""
        data += b"".join(message(n, payload=bytes(length)) for n in range(count))
    data = data[: len(data) - cut] if cut else data
    messages, others, end = one_by_one(data)
    found = records_of(data, cut=True)
    assert found.messages.tolist() == messages
    assert found.others == others
    if end == len(data):
        assert records_of(data, cut=False).messages.tolist() == messages
    else:
        with pytest.raises(ValueError, match="beyond its end"):
            records_of(data, cut=False)


@pytest.mark.parametrize("count", [0, 1, 4, 5, 31, 33, 160, 700])
def test_runs_of_any_length_before_something_else(count):
    data = b"".join(message(n) for n in range(count)) + message(0, payload=b"") + record(0x80, b"abc")
    found = records_of(data, cut=False)
    assert len(found.messages) == count + 1
    assert [opcode for opcode, _, _ in found.others] == [0x80]
