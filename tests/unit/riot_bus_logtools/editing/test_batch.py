from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.log.engine.blocks import heads_of, message_bytes
from riot_bus_logtools.editing.batch import Batch, gathered, renumbered, runs_of, shifted, with_records

ROWS = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 99), st.binary(max_size=5)), max_size=8)


def made(rows: list[tuple[int, int, bytes]]) -> Batch:
    records = [message_bytes(channel, n, time, time, payload) for n, (channel, time, payload) in enumerate(rows)]
    ends = np.cumsum([len(each) for each in records], dtype=np.int64)
    starts = ends - np.array([len(each) for each in records], np.int64)
    edit = np.array([channel for channel, _, _ in rows], np.int32)
    return Batch(b"".join(records), starts, ends, edit, np.array([time for _, time, _ in rows], np.uint64))


def records(batch: Batch) -> list[bytes]:
    return [bytes(batch.buffer[begin:end]) for begin, end in zip(batch.start, batch.end, strict=True)]


@settings(deadline=None)
@given(ROWS, ROWS)
def test_gathered_batches_have_all_records(
    first: list[tuple[int, int, bytes]], second: list[tuple[int, int, bytes]]
) -> None:
    a, b = made(first), made(second)
    both = gathered([a, b])
    assert records(both) == records(a) + records(b)
    assert both.time.tolist() == [time for _, time, _ in first + second]
    assert both.weight == sum(map(len, records(both)))
    in_order = both.by_time()
    assert in_order.time.tolist() == sorted(both.time.tolist())
    joined = b"".join(bytes(in_order.buffer[begin:end]) for begin, end in runs_of(in_order))
    assert joined == b"".join(records(in_order))


def test_details_of_some_batches_are_filled_up() -> None:
    a, b = made([(1, 1, b"")]), made([(2, 2, b"")])
    a.extras = np.array([{"a": 1}], object)
    b.changed = np.array([2], np.int32)
    both = gathered([a, b])
    assert (both.extras.tolist(), both.changed.tolist(), both.notes) == ([{"a": 1}, None], [-1, 2], None)  # type: ignore[union-attr]
    assert both.take(slice(1, None)).extras.tolist() == [None]  # type: ignore[union-attr]


def test_records_can_be_replaced() -> None:
    batch = with_records(made([(1, 1, b"a"), (1, 2, b"b")]), [1], [b"other"])
    assert records(batch)[1] == b"other"
    assert len(records(batch)) == 2


def test_times_are_shifted_as_far_as_they_fit() -> None:
    batch = made([(1, 5, b""), (1, 50, b"")])
    batch.extras = np.array([{"p": "3"}, {"p": "no number"}], object)
    found, fits = shifted(batch, np.array([-10, -10]))
    assert fits.tolist() == [False, True]
    heads = heads_of(found.buffer, found.start)
    assert (int(found.time[1]), int(heads["time"][1]), int(heads["published"][1])) == (40, 40, 40)
    assert [each["p"] for each in found.extras] == ["-7", "no number"]  # type: ignore[union-attr]
    same, fits = shifted(batch, np.array([0, 0]))
    assert (same is batch, fits.all()) == (True, True)


def test_channels_get_other_numbers() -> None:
    batch = made([(1, 5, b""), (2, 6, b"")])
    renumbered(batch, np.array([1]), np.array([7], np.uint16))
    assert heads_of(batch.buffer, batch.start)["channel"].tolist() == [1, 7]
