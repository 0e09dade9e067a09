"""What holds for all shipped interceptors, whatever the traffic."""

import json
from collections import defaultdict

from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.interceptors.copies import Duplicate, Tee
from riot_bus.interceptors.losses import Bandwidth, Drop, Throttle
from riot_bus.interceptors.payloads import ClockOffset, Corrupt, Freeze, SetField, Truncate
from riot_bus.interceptors.spelling import parse
from riot_bus.interceptors.timing import Delay, Jitter, Reorder
from riot_bus.message import Message
from riot_bus.pipeline.conditions import Selective, When
from riot_bus.pipeline.queue import EmissionQueue
from riot_bus.pipeline.runner import Pipeline
from riot_bus.types.registry import TypeRegistry, load_adapters

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
    from riot_bus.errors import ConfigError

    try:
        use, options = parse(text)
    except ConfigError:
        return
    assert isinstance(use, str)
    assert all(isinstance(value, bool | int | float | str | list | dict) for value in options.values())
