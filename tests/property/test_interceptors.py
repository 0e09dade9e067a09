"""What holds for all shipped interceptors, whatever the traffic."""

import functools
import json
import struct
import tempfile
from collections import Counter, defaultdict
from pathlib import Path

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.interceptors.catalogue import build, interceptor_list
from riot_bus.interceptors.copies import Duplicate, Tee
from riot_bus.interceptors.losses import Bandwidth, Drop, Throttle
from riot_bus.interceptors.parsing import parse
from riot_bus.interceptors.payloads import ClockOffset, Corrupt, Freeze, SetField, Truncate
from riot_bus.interceptors.timing import Delay, Jitter, Reorder
from riot_bus.pipeline.conditions import Selective, When
from riot_bus.pipeline.queue import EmissionQueue
from riot_bus.pipeline.runner import Counts, Pipeline
from riot_bus.types.model import wrap_integer
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.message import Message
from tests.tiers import scaled

TOPICS = ("a", "b/c", "d")
SECOND = 10**9
REGISTRY = load_adapters()

seconds = st.floats(0, 2)
rates = st.floats(0.1, 1000)
delays = st.builds(Delay, seconds)
keeping_order = st.one_of(
    delays,
    st.builds(Jitter, seconds, seconds),
    st.builds(Bandwidth, rates, queue=st.integers(0, 200)),
    st.builds(Throttle, rates),
    st.builds(
        lambda every, chance, burst: Drop(every, chance, burst),
        st.integers(1, 4),
        st.floats(0, 1),
        st.integers(1, 4),
    ),
)
changing_payloads = st.one_of(
    st.builds(Freeze, st.integers(0, 4)),
    st.builds(Corrupt, bits=st.integers(1, 9), count=st.integers(0, 3), offset=st.integers(0, 9)),
    st.builds(Truncate, length=st.integers(0, 30)),
    st.builds(Truncate, fraction=st.floats(0, 1)),
    st.builds(SetField, st.just("n"), st.one_of(st.integers(), st.floats(), st.text(), st.booleans())),
    st.builds(ClockOffset, st.floats(-1e9, 1e9), st.floats(-10, 10)),
    st.builds(ClockOffset, st.floats(-1e9, 1e9), field=st.just("n"), unit=st.sampled_from(["s", "ms", "us", "ns"])),
)
multiplying = st.one_of(
    st.builds(Duplicate, st.integers(1, 3), seconds), st.sampled_from(["copy/{key}", "a", "b/{topic}"]).map(Tee)
)
whens = st.builds(
    When,
    select=st.none() | st.sampled_from([*TOPICS, "**"]),
    start=st.floats(0, 2),
    first=st.integers(0, 3),
    probability=st.floats(0, 1),
    seed=st.integers(0, 3),
)
interceptors = st.one_of(keeping_order, changing_payloads, multiplying, st.builds(Reorder, seconds))


def fresh(interceptor):
    """Another one with the same options, which remembers nothing."""
    if isinstance(interceptor, Selective):
        return Selective(fresh(interceptor.interceptor), interceptor.when)
    options = {name: value for name, value in vars(interceptor).items() if not name.startswith("_")}
    return type(interceptor)(**options)


def selective(inner):
    return st.one_of(inner, st.builds(Selective, inner, whens))


payloads = st.one_of(
    st.binary(max_size=40),
    st.integers(-5, 5).map(lambda n: json.dumps({"n": n, "stamp": {"sec": n, "nanosec": abs(n)}}).encode()),
)


@st.composite
def logs(draw, contents=payloads):
    """Messages in the order of their times."""
    steps = draw(st.lists(st.integers(0, SECOND // 2), max_size=25))
    time = 0
    log = []
    for step in steps:
        time += step
        kind = draw(st.sampled_from(["put"] * 9 + ["delete"]))
        log.append(Message(time, draw(st.sampled_from(TOPICS)), draw(contents), kind, sequence=len(log)))
    return log


def run(interceptors, log):
    pipeline = Pipeline([fresh(each) for each in interceptors], registry=TypeRegistry(REGISTRY), start=0)
    return pipeline, [pipeline.feed(message) for message in log]


@settings(deadline=None)
@given(st.lists(selective(interceptors), max_size=4), logs())
def test_counts_balance_and_nothing_escapes_from_the_pipeline(row, log):
    pipeline, results = run(row, log)
    emitted = [emission for result in results for emission in result.emissions]
    for topic, counts in pipeline.counts.items():
        assert counts.delivered == counts.seen - counts.dropped + counts.copies + counts.added
        assert counts.delivered == sum(emission.message.key == topic for emission in emitted)
    assert all(emission.due >= result.original.time for result in results for emission in result.emissions)


@settings(deadline=None)
@given(st.lists(selective(interceptors), max_size=4), logs())
def test_what_is_not_changed_stays_the_same_object(row, log):
    _, results = run(row, log)
    for result in results:
        if not any(change.action in ("set", "replace") for change in result.changes):
            own = [emission for emission in result.emissions if emission.original is not None]
            assert all(emission.message is result.original for emission in own)


@settings(deadline=None)
@given(st.lists(selective(interceptors), max_size=4), logs(), st.randoms(use_true_random=False))
def test_other_topics_and_their_order_change_nothing(row, log, random):
    by_topic = defaultdict(list)
    for message in log:
        by_topic[message.key].append(message)
    waiting = [list(messages) for messages in by_topic.values()]
    mixed = []
    while any(waiting):
        mixed.append(random.choice([messages for messages in waiting if messages]).pop(0))

    def outcome(messages):
        _, results = run(row, messages)
        return {
            result.original.sequence: (result.changes, [(each.due, each.message) for each in result.emissions])
            for result in results
        }

    assert outcome(log) == outcome(mixed)


@settings(deadline=None)
@given(st.lists(keeping_order | changing_payloads, max_size=4), logs())
def test_order_within_a_topic_is_kept(row, log):
    _, results = run(row, log)
    queue = EmissionQueue()
    for result in results:
        queue.push(*result.emissions)
    arrived = defaultdict(list)
    for emission in queue.pop_due():
        arrived[emission.message.key].append(emission.message.sequence)
    assert all(order == sorted(order) for order in arrived.values())


@settings(deadline=None)
@given(st.floats(1, 500), logs())
def test_throttle_keeps_to_its_rate_in_every_window(rate, log):
    _, results = run([Throttle(rate)], log)
    times = defaultdict(list)
    for result in results:
        if not result.dropped:
            times[result.original.key].append(result.original.time)
    for passed in times.values():
        for first in range(len(passed)):
            for last in range(first, len(passed)):
                assert last - first <= (passed[last] - passed[first]) / SECOND * rate * 1.001 + 2


@settings(deadline=None)
@given(st.floats(1, 500), st.integers(0, 200), logs())
def test_bandwidth_keeps_to_its_speed_and_its_queue(speed, queue, log):
    _, results = run([Bandwidth(speed, queue)], log)
    free = defaultdict(int)
    for result in results:
        for emission in result.emissions:
            message = result.original
            waiting = max(0, free[message.key] - message.time) / SECOND * speed
            assert waiting == 0 or waiting + len(message.payload) <= queue + 1e-6
            start = max(free[message.key], message.time)
            assert emission.due - start >= len(message.payload) / speed * SECOND - 2
            free[message.key] = emission.due


@settings(deadline=None)
@given(st.integers(1, 9), st.integers(0, 3), st.integers(0, 9), st.none() | st.integers(0, 9), st.binary(max_size=40))
def test_corrupt_stays_in_its_part_and_keeps_the_length(bits, count, offset, length, payload):
    _, (result,) = run([Corrupt(bits, count, offset, length)], [Message(0, "a", payload)])
    spoilt = result.emissions[0].message.payload
    assert len(spoilt) == len(payload)
    end = len(payload) if length is None else offset + length
    places = [n for n in range(len(payload)) if spoilt[n] != payload[n]]
    assert all(offset <= place < end for place in places)
    part = max(0, min(end, len(payload)) - offset)
    if count:
        assert len(places) == min(count, part)
    else:
        flipped = sum((a ^ b).bit_count() for a, b in zip(spoilt, payload, strict=True))
        assert flipped == min(bits, 8 * part)


@settings(deadline=None)
@given(st.integers(-(2**31), 2**31 - 1), st.integers(0, SECOND - 1), st.floats(-1e6, 1e6))
def test_stamps_carry(sec, nanosec, offset):
    payload = json.dumps({"stamp": {"sec": sec, "nanosec": nanosec}}).encode()
    _, (result,) = run([ClockOffset(offset)], [Message(0, "a", payload)])
    stamp = json.loads(result.emissions[0].message.payload)["stamp"]
    assert 0 <= stamp["nanosec"] < SECOND
    assert stamp["sec"] * SECOND + stamp["nanosec"] == sec * SECOND + nanosec + round(offset * SECOND)


@settings(deadline=None)
@given(st.text())
def test_spelling_raises_nothing_but_config_errors(text):
    from riot_bus.vocabulary.errors import ConfigError

    try:
        use, options = parse(text)
    except ConfigError:
        return
    assert isinstance(use, str)
    assert all(isinstance(value, bool | int | float | str | list | dict) for value in options.values())


# Every shipped interceptor as users build it: by name, with options, conditions, types, and several ways to go.

START = 1_700_000_000_000_000_000
POINT = "geometry_msgs/msg/PointStamped"
DECLARED = {"json": "json", "msgpack": "msgpack", "ros": POINT}
TYPED = (*DECLARED, "unknown/a", "unknown/b")
INT64 = st.integers(-(1 << 63), (1 << 63) - 1)
INT32 = st.integers(-(1 << 31), (1 << 31) - 1)
UINT32 = st.integers(0, (1 << 32) - 1)
PLAN = """
[[inject]]
topic = "**"
field = "x"
value = nan
probability = 0.5

[[inject]]
topic = "json"
fault = "duplicate"
first = 2
"""


@functools.cache
def rule_file() -> Path:
    """Return a rule of one topic, so that the order of topics does not matter."""
    rule = Rule(((Literal(Feature("raw", ("json:x",)), ">", 0.5),),))
    path = Path(tempfile.mkdtemp()) / "rule.json"
    path.write_text(json.dumps({"rule": rule.to_dict(), "types": {"json:x": "float64"}, "scale": {"json:x": 1.0}}))
    return path


OPTIONS = {
    "bandwidth": st.fixed_dictionaries(
        {"bytes_per_second": st.floats(1, 1e12)}, optional={"queue": st.integers(0, 200)}
    ),
    "clock_offset": st.fixed_dictionaries(
        {"seconds": st.floats(-1e12, 1e12)},
        optional={
            "drift": st.floats(-1e6, 1e6),
            "field": st.sampled_from(["x", "stamp.sec", "name", "[", "len(a)"]),
            "unit": st.sampled_from(["s", "ms", "us", "ns"]),
        },
    ),
    "corrupt": st.fixed_dictionaries(
        {"bits": st.integers(1, 50)},
        optional={"count": st.integers(0, 50), "offset": st.integers(0, 50), "length": st.none() | st.integers(0, 50)},
    ),
    "delay": st.fixed_dictionaries({"seconds": seconds}),
    "drop": st.fixed_dictionaries(
        {}, optional={"every": st.integers(1, 5), "chance": st.floats(0, 1), "burst": st.integers(1, 4)}
    ),
    "duplicate": st.fixed_dictionaries({"copies": st.integers(1, 3)}, optional={"spacing": seconds}),
    "freeze": st.fixed_dictionaries({"hold": st.integers(0, 4)}),
    "guard": st.fixed_dictionaries({"action": st.sampled_from(["drop", "clamp", "hold", "report"])}).map(
        lambda chosen: {"rule": str(rule_file()), **chosen}
    ),
    "inject": st.fixed_dictionaries({"seed": st.integers(0, 5)}),
    "jitter": st.fixed_dictionaries({"seconds": seconds, "spread": seconds}),
    "record": st.just({}),
    "reorder": st.fixed_dictionaries({"window": seconds}),
    "set": st.fixed_dictionaries(
        {
            "field": st.sampled_from(["x", "stamp.sec", "header.frame_id", "name", "a[0]", "value", "no.such", "]"]),
            "value": st.booleans() | st.integers() | st.floats() | st.text(max_size=4),
        }
    ),
    "tee": st.fixed_dictionaries({"key": st.sampled_from(["copy", "{key}", "copy/{topic}/of/{key}"])}),
    "throttle": st.fixed_dictionaries({"rate": st.floats(0.1, 1e6)}),
    "truncate": st.fixed_dictionaries({"length": st.integers(0, 50)})
    | st.fixed_dictionaries({"fraction": st.floats(0, 1)}),
}
CONDITIONS = st.fixed_dictionaries(
    {"seed": st.integers(0, 3)},
    optional={
        "select": st.sampled_from(["**", "json", "unknown/*", ["json", "ros where header.stamp.sec > 0"]]),
        "from": st.sampled_from(["here", "there"]),
        "to": st.sampled_from(["b", "c"]),
        "start": st.floats(0, 1),
        "end": st.floats(1.5, 3),
        "first": st.integers(0, 5),
        "last": st.integers(5, 20),
        "where": st.sampled_from(["x > 0.5", "name > 'a'", "x == nan or stamp.sec < 3"]),
        "probability": st.floats(0, 1),
    },
)
TARGETS = st.sampled_from([(), ("b",), ("b", "c"), ("b", "c", "d")])


@pytest.fixture(scope="module")
def make(tmp_path_factory):
    """Build a shipped interceptor by name, with the files that it needs."""
    folder = tmp_path_factory.mktemp("interceptors")
    (folder / "plan.toml").write_text(PLAN)
    files = {"inject": {"plan": str(folder / "plan.toml")}, "record": {"path": str(folder / "out.mcap")}}
    return lambda name, options: build(name, {**files.get(name, {}), **options})


def point(sec, nanosec, frame=b""):
    padding = bytes(-(12 + len(frame) + 1) % 8)
    head = struct.pack("<iII", sec, nanosec, len(frame) + 1) + frame + b"\x00"
    return b"\x00\x01\x00\x00" + head + padding + struct.pack("<3d", 1, 2, 3)


def documents():
    stamps = st.fixed_dictionaries({"sec": INT64, "nanosec": INT64 | st.floats()})
    return st.fixed_dictionaries(
        {},
        optional={
            "x": st.floats() | INT64 | st.booleans() | st.none(),
            "name": st.sampled_from(["a", "b"]),
            "a": st.lists(INT64, max_size=3),
            "stamp": stamps | st.integers(0, 9),
        },
    )


def as_json(document):
    return json.dumps(document).encode()


def contents(topic):
    """Payloads of the topic's type, and hostile ones: cut, spoiled, or anything."""
    blob = st.fixed_dictionaries({"name": st.binary(max_size=2), "x": st.floats()})
    packed = (documents() | blob).map(msgpack.packb)
    printed = documents().map(as_json)
    points = st.builds(point, INT32, UINT32, st.binary(max_size=5).map(lambda name: name.hex().encode()))
    good = {"json": printed, "msgpack": packed, "ros": points}.get(topic, printed | packed)
    place, other = st.integers(0, 60), st.binary(max_size=4)
    spoiled = st.builds(lambda data, at, part: data[:at] + part + data[at + len(part) :], good, place, other)
    return good | spoiled | st.builds(lambda data, end: data[:end], good, place) | st.binary(max_size=40)


STEPS = st.sampled_from([0, 1, 10**6, 10**8]) | st.integers(0, 5 * 10**8)
ROW = st.sampled_from(TYPED).flatmap(lambda topic: st.tuples(st.just(topic), STEPS, contents(topic)))
ROWS = st.lists(ROW, max_size=25)


def log_of(rows):
    """Return messages in the order of the rows; each topic has times of its own, as if the others were not there."""
    now, log = dict.fromkeys(TYPED, START), []
    for number, (topic, step, payload) in enumerate(rows):
        now[topic] += step
        log.append(Message(now[topic], topic, payload, sequence=number, segment="here"))
    return log


def run_one(interceptor, log, targets=()):
    pipeline = Pipeline([interceptor], registry=TypeRegistry(REGISTRY, declared=DECLARED), start=START)
    results = [pipeline.feed(message, targets=targets) for message in log]
    pipeline.close()
    return pipeline, results


def test_every_shipped_interceptor_is_tried():
    assert set(OPTIONS) == {each["name"] for each in interceptor_list()}


@pytest.mark.parametrize("name", sorted(OPTIONS))
@settings(deadline=None, max_examples=scaled(30))
@given(data=st.data())
def test_whatever_comes_passes_and_is_counted(make, name, data):
    log, targets = log_of(data.draw(ROWS)), data.draw(TARGETS)
    pipeline, results = run_one(make(name, data.draw(OPTIONS[name]) | data.draw(CONDITIONS)), log, targets)
    delivered = Counter(emission.message.key for result in results for emission in result.emissions)
    seen = Counter(message.key for message in log)
    for topic in {*pipeline.counts, *delivered, *seen}:
        counts = pipeline.counts.get(topic, Counts())
        assert counts.delivered == delivered[topic] == counts.seen - counts.dropped + counts.copies + counts.added
        assert counts.seen == seen[topic]
    for result in results:
        own = [emission for emission in result.emissions if emission.original is not None]
        assert result.dropped == (not own)
        for emission in own:
            if not any(change.action in ("set", "replace") for change in emission.changes):
                assert emission.message is result.original
            assert emission.message == result.original.with_payload(emission.message.payload)
        if not result.changes:
            assert all(emission.due == result.original.time for emission in own)
            assert sorted(each for emission in own for each in emission.targets or targets) == sorted(targets)


@pytest.mark.parametrize("name", sorted(OPTIONS))
@settings(deadline=None, max_examples=scaled(30))
@given(data=st.data())
def test_seed_and_content_decide_and_not_the_order_of_topics(make, name, data):
    rows, targets = data.draw(ROWS), data.draw(TARGETS)
    options = data.draw(OPTIONS[name]) | data.draw(CONDITIONS)

    def fates(rows):
        pipeline, results = run_one(make(name, options), log_of(rows), targets)
        told = {}
        for result in results:
            what = [(each.due, each.message.key, each.message.payload, each.targets) for each in result.emissions]
            told.setdefault(result.original.key, []).append((what, repr(result.changes)))
        return told, [error.count for error in pipeline.errors.values()]

    assert fates(rows) == fates(rows)
    order = data.draw(st.permutations([topic for topic, _, _ in rows]))
    left = {topic: iter([row for row in rows if row[0] == topic]) for topic in TYPED}
    assert fates([next(left[topic]) for topic in order]) == fates(rows)
    for topic, fate in fates(rows)[0].items():
        assert fates([row for row in rows if row[0] == topic])[0] == {topic: fate}


@settings(deadline=None)
@given(st.lists(ROW, min_size=1, max_size=25), st.integers(0, 1000))
def test_another_seed_draws_other_numbers(rows, seed):
    def draws(seed):
        found = []
        spy = type("Spy", (), {"message": lambda self, event: found.append(event.draw())})
        run_one(Selective(spy(), When(seed=seed)), log_of(rows))
        return found

    assert draws(seed) == draws(seed)
    assert not set(draws(seed)) & set(draws(seed + 1))


@pytest.mark.parametrize("name", ["freeze", "throttle", "drop", "jitter", "corrupt", "truncate"])
@settings(deadline=None, max_examples=scaled(30))
@given(data=st.data())
def test_a_message_on_two_ways_is_one_message(make, name, data):
    """What was split for another interceptor's sake meets the same fate on each way."""
    log = log_of(data.draw(ROWS))
    interceptors = [build("delay", {"seconds": 0, "to": "b"}), make(name, data.draw(OPTIONS[name]))]
    _, whole = run_one(fresh(interceptors[1]), log)
    pipeline = Pipeline(interceptors, registry=TypeRegistry(REGISTRY, declared=DECLARED), start=START)
    for message, alone in zip(log, whole, strict=True):
        expected = [(each.due, each.message.payload) for each in alone.emissions]
        found = pipeline.feed(message, targets=("b", "c")).emissions
        for target in ("b", "c"):
            assert [(each.due, each.message.payload) for each in found if each.targets == (target,)] == expected


@settings(deadline=None)
@given(st.lists(st.binary(max_size=60), max_size=8), OPTIONS["truncate"])
def test_truncate_leaves_the_beginning(payloads, options):
    _, results = run_one(build("truncate", options), log_of([("unknown/a", 1, payload) for payload in payloads]))
    for result in results:
        before, after = result.original.payload, result.emissions[0].message.payload
        assert before.startswith(after)
        if "length" in options:
            assert len(after) == min(len(before), options["length"])
        else:
            assert len(after) == int(options["fraction"] * len(before))
        assert (result.emissions[0].message is result.original) == (len(before) == len(after))


@settings(deadline=None)
@given(ROWS, st.integers(0, 4), st.integers(0, 5), st.integers(5, 30))
def test_freeze_repeats_the_first_of_each_block(rows, hold, first, last):
    pipeline, results = run_one(build("freeze", {"hold": hold, "first": first, "last": last}), log_of(rows))
    for topic in TYPED:
        mine = [result for result in results if result.original.key == topic]
        for index, result in enumerate(mine):
            model = index
            if first <= index <= last:
                model = index - (index - first) % (hold + 1) if hold else first
            assert result.emissions[0].message.payload == mine[model].original.payload
    assert not pipeline.errors


@settings(deadline=None)
@given(
    st.fixed_dictionaries(
        {"seconds": st.floats(-1e10, 1e10) | st.sampled_from([0.0, -1e-9, 1e-9, -0.5])},
        optional={"drift": st.floats(-10, 10)},
    ),
    INT32,
    UINT32,
    st.integers(0, 2),
    STEPS,
)
def test_stamps_carry_and_wrap_as_their_type_does(options, sec, nanosec, earlier, step):
    document = {"header": {"stamp": {"sec": sec, "nanosec": nanosec}}, "x": 1}
    cases = {
        "json": (as_json(document), lambda data: json.loads(data)["header"]["stamp"].values(), 64),
        "msgpack": (msgpack.packb(document), lambda data: msgpack.unpackb(data)["header"]["stamp"].values(), 64),
        "ros": (point(sec, nanosec, b"map"), lambda data: struct.unpack("<iI", data[4:12]), 32),
    }
    for topic, (payload, stamp, bits) in cases.items():
        log = log_of([(topic, step, payload)] * (earlier + 1))
        pipeline, results = run_one(build("clock_offset", options), log)
        offset = options["seconds"] + options.get("drift", 0.0) * ((log[-1].time - START) / 1e9)
        carried, rest = divmod(sec * SECOND + nanosec + round(offset * SECOND), SECOND)
        sec_after, nanosec_after = stamp(results[-1].emissions[0].message.payload)
        assert 0 <= nanosec_after < SECOND
        assert (sec_after, nanosec_after) == (wrap_integer(carried, bits=bits, signed=True), rest)
        assert not pipeline.errors


@settings(deadline=None)
@given(st.floats(-1e15, 1e15), INT64, st.floats(allow_nan=False), st.sampled_from(["s", "ms", "us", "ns"]))
def test_a_field_of_time_wraps_as_its_type_does(shift, whole, real, unit):
    scale = {"s": 1, "ms": 1e3, "us": 1e6, "ns": 1e9}[unit]
    for value in (whole, real):
        log = log_of([("json", 1, as_json({"t": value}))])
        pipeline, (result,) = run_one(build("clock_offset", {"seconds": shift, "field": "t", "unit": unit}), log)
        after = json.loads(result.emissions[0].message.payload)["t"]
        if isinstance(value, int):
            assert after == wrap_integer(value + round(shift * scale), bits=64, signed=True)
        else:
            assert after == value + shift * scale
        assert not pipeline.errors
