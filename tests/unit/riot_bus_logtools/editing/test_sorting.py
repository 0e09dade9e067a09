import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.log.engine.blocks import heads_of, message_bytes
from riot_bus_logtools.editing.batch import Batch, Sorter, gathered, shifted


def batch(times, label=0):
    """Messages of these times; their payloads say which is which."""
    records = [message_bytes(1, n, time, time, b"%d/%d" % (label, n)) for n, time in enumerate(times)]
    lengths = np.array([len(record) for record in records], np.int64)
    ends = np.cumsum(lengths)
    return Batch(
        b"".join(records), ends - lengths, ends, np.full(len(times), label, np.int32), np.array(times, np.uint64)
    )


def payloads(found):
    return [found.buffer[begin + 31 : end] for begin, end in zip(found.start.tolist(), found.end.tolist(), strict=True)]


@settings(deadline=None)
@given(st.lists(st.lists(st.integers(0, 30) | st.integers(0, 2**64 - 1), max_size=8), max_size=6), st.booleans())
def test_all_messages_leave_in_the_order_of_time_and_those_of_equal_time_by_rank(blocks, backwards):
    blocks.sort(key=lambda times: min(times, default=0))
    sorter = Sorter()
    found = []
    for place, times in enumerate(blocks):
        rank = (len(blocks) - place if backwards else place, 0)
        sorter.add(rank, batch(times, place))
        following = blocks[place + 1] if place + 1 < len(blocks) else None
        ready = sorter.ready(None if following is None else min(following, default=0))
        found += payloads(ready) if ready is not None else []
    rows = [
        (time, len(blocks) - place if backwards else place, n, b"%d/%d" % (place, n))
        for place, times in enumerate(blocks)
        for n, time in enumerate(times)
    ]
    assert found == [row[3] for row in sorted(rows)]


def test_messages_that_overlap_too_much_leave_early():
    sorter = Sorter(most=10_000)
    held, left = [], 0
    for n in range(100):
        sorter.add((n, 0), batch([n, 1000 + n, 2000 + n], n))
        ready = sorter.ready(n + 1)
        left += 0 if ready is None else len(ready)
        held.append(3 * (n + 1) - left)
    assert max(held) < 110
    rest = sorter.ready(None)
    assert rest is not None
    assert left + len(rest) == 300


def test_a_batch_that_is_in_order_is_not_touched():
    one = batch([1, 2, 2, 5])
    sorter = Sorter()
    sorter.add((0, 0), one)
    assert sorter.ready(6) is one
    assert not len(sorter.ready(None))


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 2**64 - 1), st.integers(-(2**62), 2**62)), max_size=10))
def test_times_are_moved_in_the_records(rows):
    found, fits = shifted(batch([time for time, _ in rows]), np.array([delta for _, delta in rows], np.int64))
    assert fits.tolist() == [0 <= time + delta < 2**64 for time, delta in rows]
    right = [time + delta for (time, delta), fit in zip(rows, fits.tolist(), strict=True) if fit]
    assert found.time[fits].tolist() == right
    heads = heads_of(found.buffer, found.start[fits])
    assert heads["time"].tolist() == heads["published"].tolist() == right


def test_batches_are_put_together_with_what_belongs_to_them():
    one, two = batch([1, 2], 0), batch([3], 1)
    two.extras = np.array([{"a": b"x"}], object)
    found = gathered([one, batch([], 7), two])
    assert payloads(found) == [b"0/0", b"0/1", b"1/0"]
    assert found.extras is not None
    assert found.extras.tolist() == [None, None, {"a": b"x"}]
    assert (found.notes, found.changed) == (None, None)
    assert found.edit.tolist() == [0, 0, 1]
    assert len(gathered([])) == 0
