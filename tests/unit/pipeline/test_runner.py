import pytest

from riot_bus.pipeline.event import Change
from riot_bus.pipeline.runner import Counts, Pipeline
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, PayloadError
from riot_bus.vocabulary.message import Message

JSON = b'{"speed": 1.5, "mode": 2}'


def message(key="rover/odom", payload=JSON, time=1_000_000_000, **more):
    return Message(time, key, payload, **more)


def act(action, **attributes):
    kind = type("Act", (), {"message": lambda self, event: action(event), **attributes})
    return kind()


def pipeline(*interceptors, **more):
    return Pipeline(interceptors, registry=TypeRegistry(), **more)


def test_untouched_message_passes_as_the_same_object():
    original = message()
    result = pipeline(act(lambda event: event.read("speed"))).feed(original)
    assert [emission.message for emission in result.emissions] == [original]
    assert result.emissions[0].message is original
    assert result.emissions[0].due == original.time
    assert result.changes == ()


def test_set_is_recorded_with_before_and_after():
    result = pipeline(act(lambda event: event.set("speed", 9.5))).feed(message())
    assert result.emissions[0].message.payload == b'{"speed": 9.5, "mode": 2}'
    assert result.changes == (Change("Act", "set", "speed", 1.5, 9.5),)
    assert result.emissions[0].original == message()


def test_silent_replacement_is_recorded_too():
    def swap(event):
        event.message = event.message.with_(payload=b"x")

    assert pipeline(act(swap)).feed(message()).changes == (Change("Act", "replace"),)


def test_drop_is_visible_and_ends_the_row():
    later = []
    result = pipeline(act(lambda event: event.drop()), act(later.append)).feed(message())
    assert result.dropped
    assert result.emissions == ()
    assert result.changes[0].action == "drop"
    assert later == []


def test_delay_duplicate_and_add_are_separate_emissions():
    extra = message("rover/alarm", b"{}")

    def all_three(event):
        event.delay(0.5)
        event.duplicate(2)
        event.add(extra, seconds=1.0)

    run = pipeline(act(all_three))
    original = message()
    result = run.feed(original)
    assert [emission.due - original.time for emission in result.emissions] == [500_000_000] * 3 + [1_000_000_000]
    assert result.emissions[-1].original is None
    assert run.counts["rover/odom"] == Counts(seen=1, delayed=1, copies=2, delivered=3)
    assert run.counts["rover/alarm"] == Counts(added=1, delivered=1)


def test_raising_interceptor_is_isolated_counted_and_stays():
    def spoil(event):
        event.set("speed", 0.0)
        event.drop()
        event.add(event.message)
        raise RuntimeError("boom")

    run = pipeline(act(spoil, name="bad"), act(lambda event: event.set("mode", 3)))
    for _ in range(2):
        result = run.feed(message())
        assert result.emissions[0].message.payload == b'{"speed": 1.5, "mode": 3}'
        assert len(result.changes) == 1
    assert run.errors["bad"].count == 2
    assert "boom" in run.errors["bad"].first


def test_topics_restrict_what_an_interceptor_sees():
    seen = []
    run = pipeline(act(lambda event: seen.append(event.message.key), topics=["rover/*", "b:x"]))
    for key in ("rover/odom", "b", "other/odom"):
        run.feed(message(key))
    assert seen == ["rover/odom", "b"]


def test_index_counts_per_topic_and_seconds_from_the_first_message():
    seen = []
    run = pipeline(act(lambda event: seen.append((event.topic, event.index, event.seconds))))
    for time, key in ((10**9, "a"), (2 * 10**9, "b"), (3 * 10**9, "a")):
        run.feed(message(key, time=time))
    assert seen == [("a", 0, 0.0), ("b", 0, 1.0), ("a", 1, 2.0)]


def test_types_are_looked_up_once_per_key_and_per_message_only_when_needed():
    class Registry(TypeRegistry):
        asked = 0

        def type_of(self, key, *, payload=None, encoding=""):
            self.asked += 1
            return super().type_of(key, payload=payload, encoding=encoding)

    registry = Registry()
    calm = Pipeline([act(lambda event: event.delay(0.1))], registry=registry)
    for _ in range(3):
        calm.feed(message())
    assert registry.asked == 1
    kinds = []
    Pipeline([act(lambda event: kinds.append((event.type, event.type)))], registry=registry).feed(message())
    assert registry.asked == 3
    assert kinds[0][0].name == "json"


def test_unknown_type_says_so():
    problems = []

    def read(event):
        try:
            event.read("x")
        except PayloadError as error:
            problems.append(error)

    pipeline(act(read)).feed(message(payload=b"\xff\xff"))
    assert "unknown" in str(problems[0])


def test_hooks_run_once_and_their_errors_are_isolated():
    calls = []

    class Hooked:
        def load(self, registry):
            calls.append("load")

        def start(self):
            calls.append("start")

        def stop(self):
            calls.append("stop")
            raise RuntimeError("late")

        def message(self, event):
            calls.append("message")

    run = pipeline(Hooked())
    run.feed(message())
    run.close()
    run.close()
    assert calls == ["load", "start", "message", "stop"]
    assert run.errors["Hooked"].count == 1


def test_two_of_a_kind_have_different_names():
    def fail(event):
        raise ValueError

    run = pipeline(act(fail), act(fail))
    run.feed(message())
    assert set(run.errors) == {"Act", "Act#2"}


def test_object_without_message_is_refused():
    with pytest.raises(ConfigError, match="no method message"):
        pipeline(object())
