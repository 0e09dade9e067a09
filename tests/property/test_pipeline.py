import json

from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.pipeline.queue import EmissionQueue
from riot_bus.pipeline.runner import Counts, Pipeline
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message

ACTIONS = ("pass", "read", "set", "drop", "delay", "duplicate", "add", "raise", "spoil")
TOPICS = ("a", "b/c", "d")


class Scripted:
    """Does to the n-th message what the script says."""

    def __init__(self, script, topics):
        self.script = script
        self.topics = topics
        self.at = 0

    def message(self, event):
        action = self.script[self.at % len(self.script)]
        self.at += 1
        match action:
            case "read":
                event.read("x")
            case "set":
                event.set("x", 2.5)
            case "drop":
                event.drop()
            case "delay":
                event.delay(0.001)
            case "duplicate":
                event.duplicate(2)
            case "add":
                event.add(Message(0, "d", b"{}"), seconds=0.002)
            case "raise":
                raise ValueError("scripted")
            case "spoil":
                event.set("x", 9.5)
                event.duplicate()
                event.drop()
                raise ValueError("after the fact")


def messages():
    times = st.lists(st.tuples(st.sampled_from(TOPICS), st.integers(0, 5)), max_size=30)
    return times.map(
        lambda rows: [
            Message(1000 + 10**6 * n + step, key, json.dumps({"x": float(n)}).encode())
            for n, (key, step) in enumerate(rows)
        ]
    )


scripts = st.lists(
    st.tuples(
        st.lists(st.sampled_from(ACTIONS), min_size=1, max_size=8), st.none() | st.lists(st.sampled_from(TOPICS))
    ),
    max_size=3,
)


@settings(deadline=None)
@given(messages(), scripts)
def test_counts_balance_and_nothing_untouched_is_copied(log, rows):
    pipeline = Pipeline([Scripted(*row) for row in rows], registry=TypeRegistry())
    results = [pipeline.feed(message) for message in log]
    emitted = [emission for result in results for emission in result.emissions]
    for topic in TOPICS:
        counts = pipeline.counts.get(topic, Counts())
        delivered = sum(emission.message.key == topic for emission in emitted)
        assert counts.delivered == delivered
        assert counts.seen == delivered - counts.added - counts.copies + counts.dropped
        assert counts.seen == sum(message.key == topic for message in log)
    for result in results:
        own = [emission for emission in result.emissions if emission.original is not None]
        assert result.dropped == (not own)
        if not result.changes:
            assert [emission.message for emission in result.emissions] == [result.original]
            assert own[0].message is result.original
            assert own[0].due == result.original.time
        if not any(change.action in ("set", "replace") for change in result.changes):
            assert all(emission.message is result.original for emission in own)


@settings(deadline=None)
@given(
    st.lists(st.lists(st.sampled_from(("set", "delay", "raise", "spoil", "pass")), min_size=1), max_size=3), messages()
)
def test_raising_interceptors_leave_no_trace(scripts, log):
    tame = [["pass" if action in ("raise", "spoil") else action for action in script] for script in scripts]
    wild, calm = (Pipeline([Scripted(s, None) for s in each], registry=TypeRegistry()) for each in (scripts, tame))
    for message in log:
        one, two = wild.feed(message), calm.feed(message)
        assert [(e.due, e.message) for e in one.emissions] == [(e.due, e.message) for e in two.emissions]
        assert one.changes == two.changes


@settings(deadline=None)
@given(messages(), st.lists(st.integers(0, 40 * 10**6)))
def test_the_queue_loses_nothing_and_sorts_stably(log, moments):
    pipeline = Pipeline([Scripted(["pass", "delay", "duplicate", "add"], None)], registry=TypeRegistry())
    emissions = [emission for message in log for emission in pipeline.feed(message).emissions]
    queue = EmissionQueue()
    queue.push(*emissions)
    out = []
    for moment in sorted(moments):
        out.extend(queue.pop_due(moment))
        assert queue.next_due() is None or queue.next_due() > moment
    out.extend(queue.pop_due())
    assert out == sorted(emissions, key=lambda emission: emission.due)
