import json
import math
import struct

import pytest

from riot_bus.interceptors.payloads import ClockOffset, Corrupt, Freeze, SetField, Truncate
from riot_bus.pipeline.conditions import Selective, When
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message


def numbers(run):
    return [json.loads(payload)["n"] for payload in run.payloads()]


def test_freeze_repeats_the_first_selected_value_of_each_topic(bench):
    run = bench(Selective(Freeze(), When(start=0.2, end=0.6)))
    for n in range(8):
        run.feed(0.1 * n + 0.01, {"n": n})
        run.feed(0.1 * n + 0.01, {"n": -n}, key="b")
    assert numbers(run)[::2] == [0, 1, 2, 2, 2, 2, 6, 7]
    assert numbers(run)[1::2] == [0, -1, -2, -2, -2, -2, -6, -7]


def test_a_gap_in_the_selection_starts_anew(bench):
    run = bench(Selective(Freeze(), When(where="go == true")))
    for n, go in enumerate([True, True, False, True, True]):
        run.feed(0.1 * n, {"n": n, "go": go})
    assert numbers(run) == [0, 0, 2, 3, 3]


def test_freeze_holds_for_so_many_messages(bench):
    run = bench(Freeze(hold=2))
    for n in range(7):
        run.feed(0.1 * n, {"n": n})
    assert numbers(run) == [0, 0, 0, 3, 3, 3, 6]


def test_a_delete_stays_one_and_ends_the_freeze(bench):
    run = bench(Freeze())
    run.feed(0.0, {"n": 0})
    run.feed(0.1, b"", kind="delete")
    run.feed(0.2, {"n": 2})
    assert run.payloads() == [b'{"n": 0}', b"", b'{"n": 2}']


def test_each_way_repeats_what_went_there():
    """An interceptor before it has changed what goes to one segment."""
    before = Selective(SetField("n", -1), When(target="b", last=0))
    pipeline = Pipeline([before, Freeze()], registry=TypeRegistry())
    for n in range(3):
        result = pipeline.feed(Message(n, "a", b'{"n": %d}' % n), targets=("b", "c"))
        assert {each.targets: each.message.payload for each in result.emissions} == {
            ("b",): b'{"n": -1}',
            ("c",): b'{"n": 0}',
        }


def test_freeze_forgets_rather_than_take_the_memory(bench, monkeypatch):
    monkeypatch.setattr("riot_bus.interceptors.payloads._FROZEN_BYTES", 10_000)
    run = bench(Freeze())
    for n in range(50):
        run.feed(0.1 * n, bytes(1000), key=f"hostile/{n}")
    assert len(run.pipeline.stages[0].interceptor._frozen) < 10


def test_corrupt_flips_bits(bench):
    run = bench(Corrupt(bits=3))
    run.feed(payload=bytes(10))
    (spoilt,) = run.payloads()
    assert sum(byte.bit_count() for byte in spoilt) == 3


def test_corrupt_replaces_bytes_in_a_part(bench):
    run = bench(Corrupt(count=2, offset=4, length=3))
    payload = bytes(range(20))
    run.feed(payload=payload)
    (spoilt,) = run.payloads()
    places = [n for n in range(20) if spoilt[n] != payload[n]]
    assert len(places) == 2
    assert all(4 <= place < 7 for place in places)


def test_corrupt_spoils_no_more_than_there_is(bench):
    run = bench(Corrupt(bits=100))
    for payload, spoilt in ((b"", b""), (b"\x00", b"\xff")):
        run.feed(payload=payload)
        assert run.payloads()[-1] == spoilt
    beyond = bench(Corrupt(count=9, offset=5))
    assert beyond.feed(payload=b"12345").changes == ()


def test_corrupt_depends_on_seed_and_content(bench):
    def spoilt(seed, payload):
        run = bench(Selective(Corrupt(), When(seed=seed)))
        run.feed(payload=payload)
        return run.payloads()[0]

    assert spoilt(1, bytes(99)) == spoilt(1, bytes(99)) != spoilt(2, bytes(99))


@pytest.mark.parametrize(
    ("interceptor", "left"),
    [(Truncate(length=4), b"0123"), (Truncate(length=99), b"0123456789"), (Truncate(fraction=0.25), b"01")],
)
def test_truncate(bench, interceptor, left):
    run = bench(interceptor)
    result = run.feed(payload=b"0123456789")
    assert run.payloads() == [left]
    assert bool(result.changes) == (len(left) < 10)


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda: Freeze(hold=-1), "below 0"),
        (lambda: Corrupt(offset=-1), "0 or more"),
        (lambda: Corrupt(bits=0), "nothing is to be spoiled"),
        (Truncate, "either length"),
        (lambda: Truncate(length=1, fraction=0.5), "either length"),
        (lambda: Truncate(fraction=1.5), "between 0 and 1"),
        (lambda: Truncate(fraction=math.nan), "between 0 and 1"),
        (lambda: ClockOffset(math.nan), "finite"),
        (lambda: ClockOffset(1.0, drift=math.inf), "finite"),
    ],
)
def test_wrong_options(make, problem):
    with pytest.raises(ConfigError, match=problem):
        make()


@pytest.mark.parametrize(
    ("value", "payload"),
    [(2, b'{"x": 2.0, "y": 1}'), ("nan", b'{"x": NaN, "y": 1}'), (math.inf, b'{"x": Infinity, "y": 1}')],
)
def test_set(bench, value, payload):
    run = bench(SetField("x", value))
    run.feed(payload=b'{"x": 1.5, "y": 1}')
    assert run.payloads() == [payload]


def test_set_that_cannot_be_is_an_error_that_says_why():
    pipeline = Pipeline([SetField("pose.x", 1)], registry=TypeRegistry())
    result = pipeline.feed(Message(0, "a", b'{"x": 1}'))
    assert result.emissions[0].message is result.original
    assert "no field 'pose'" in pipeline.errors["set"].first


@pytest.mark.parametrize(
    ("seconds", "sec", "nanosec"),
    [(0.5, 11, 400_000_000), (-1.0, 9, 900_000_000), (-0.95, 9, 950_000_000), (0.1, 11, 0), (-20, -10, 900_000_000)],
)
def test_stamps_are_shifted_with_carry(bench, seconds, sec, nanosec):
    run = bench(ClockOffset(seconds))
    run.feed(payload={"header": {"stamp": {"sec": 10, "nanosec": 900_000_000}}, "sec": 1, "nanosec": 2})
    shifted = json.loads(run.payloads()[0])
    assert shifted == {"header": {"stamp": {"sec": sec, "nanosec": nanosec}}, "sec": 1, "nanosec": 2}


def test_all_stamps_are_shifted_also_in_long_arrays(bench):
    run = bench(ClockOffset(1))
    stamp = {"stamp": {"sec": 1, "nanosec": 0}}
    run.feed(payload={"header": stamp, "parts": [stamp] * 100, "groups": [{"parts": [stamp] * 20}] * 3})
    assert run.payloads()[0].count(b'"sec": 2') == 161


def test_drift_grows_with_time(bench):
    run = bench(ClockOffset(1.0, drift=0.1, field="t"))
    for seconds in (0.0, 5.0):
        run.feed(seconds, {"t": 100.0})
    assert [json.loads(payload)["t"] for payload in run.payloads()] == [101.0, 101.5]


@pytest.mark.parametrize(
    ("unit", "before", "after"),
    [("s", 10, 12), ("ms", 10, 1510), ("us", 10, 1_500_010), ("ns", 10, 1_500_000_010), ("ms", 0.5, 1500.5)],
)
def test_units(bench, unit, before, after):
    run = bench(ClockOffset(1.5, field="t", unit=unit))
    run.feed(payload={"t": before})
    assert json.loads(run.payloads()[0]) == {"t": after}


def test_messages_without_stamps_pass_as_they_are(bench):
    run = bench(ClockOffset(1.0))
    for n, payload in enumerate(
        [b'{"stamp": {"sec": 1}}', b'{"stamp": {"sec": "1", "nanosec": 2}}', b"\xff\xff", b"[]"]
    ):
        assert run.feed(payload=payload, key=f"k{n}").changes == ()


def test_a_field_that_is_no_time_is_an_error():
    pipeline = Pipeline([ClockOffset(1.0, field="t")], registry=TypeRegistry())
    pipeline.feed(Message(0, "a", b'{"t": "noon"}'))
    assert "'noon' is not a time" in pipeline.errors["clock_offset"].first


def test_seconds_of_ros_wrap_in_32_bits():
    key = "0/stamp/std_msgs::msg::dds_::Header_/TypeHashNotSupported"
    registry = TypeRegistry(load_adapters(["ros2"]), declared={"raw": "std_msgs/msg/Header"})
    pipeline = Pipeline([ClockOffset(1.0, field="stamp.sec")], registry=registry)
    payload = b"\0\1\0\0" + struct.pack("<iI", 2**31 - 1, 7) + b"\x04\0\0\0map\0"
    result = pipeline.feed(Message(0, key, payload))
    assert result.emissions[0].message.payload[4:12] == struct.pack("<iI", -(2**31), 7)
    assert pipeline.errors == {}


def test_stamps_of_ros_messages():
    key = "0/stamp/geometry_msgs::msg::dds_::PointStamped_/TypeHashNotSupported"
    registry = TypeRegistry(load_adapters(["ros2"]))
    pipeline = Pipeline([ClockOffset(-1.5)], registry=registry)
    tail = b"\x04\0\0\0map\0" + bytes(24)
    result = pipeline.feed(Message(0, key, b"\0\1\0\0" + struct.pack("<iI", 10, 250_000_000) + tail))
    assert result.emissions[0].message.payload == b"\0\1\0\0" + struct.pack("<iI", 8, 750_000_000) + tail
    assert [change.field for change in result.changes] == ["header.stamp.sec", "header.stamp.nanosec"]
