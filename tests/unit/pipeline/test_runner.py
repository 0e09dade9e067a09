import pytest

from riot_bus.pipeline import runner
from riot_bus.pipeline.event import Change
from riot_bus.pipeline.runner import AbandonedError, Counts, Pipeline
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


def test_numbers_and_time_can_begin_anew_while_counts_go_on():
    seen = []
    pipe = pipeline(act(lambda event: seen.append((event.index, event.seconds))))
    for time in (1, 2):
        pipe.feed(message(time=time * 1_000_000_000))
    pipe.restart()
    for time in (5, 6):
        pipe.feed(message(time=time * 1_000_000_000))
    pipe.feed(message(key="rover/new", time=8_000_000_000))
    assert seen == [(0, 0.0), (1, 1.0), (0, 0.0), (1, 1.0), (0, 3.0)]
    assert pipe.counts["rover/odom"].seen == 4


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


def test_replacing_starts_the_new_ones_stops_the_old_ones_and_leaves_those_that_stay():
    calls = []

    def hooked(name):
        def note(hook):
            return lambda self, *_: calls.append(f"{name} {hook}")

        return type(name, (), {hook: note(hook) for hook in ("load", "start", "stop")} | {"message": lambda *_: None})()

    stays, goes, comes = hooked("stays"), hooked("goes"), hooked("comes")
    run = pipeline(stays, goes)
    run.feed(message())
    calls.clear()
    run.replace([comes, stays])
    assert calls == ["comes load", "goes stop", "comes start"]


def test_an_abandoned_interceptor_is_bypassed_and_stays_so_when_others_are_replaced():
    seen, others = [], []

    def hangs(event):
        seen.append(event)
        assert run.abandon(run.current, "too slow", "file:1")
        assert not run.abandon(run.current, "too slow", "file:1")

    slow, other = act(hangs), act(others.append)
    run = pipeline(slow, other)
    with pytest.raises(AbandonedError, match="came back too late"):
        run.feed(message())
    assert others == []
    run.feed(message())
    run.replace([slow])
    run.call(run.stages[0], "stop")
    run.feed(message())
    assert (len(seen), len(others)) == (1, 1)
    assert run.errors["Act"].first == "file:1: too slow"


@pytest.mark.parametrize("name", ["targets", "branches"])
def test_interceptors_cannot_set_where_a_message_goes(name):
    run = pipeline(act(lambda event: setattr(event, name, ("b",))))
    result = run.feed(message(), targets=("a", "b"))
    assert [emission.targets for emission in result.emissions] == [None]
    assert "cannot be set" in run.errors["Act"].first


def test_ctrl_c_while_a_log_is_worked_on_is_no_error_of_an_interceptor():
    def interrupted(event):
        raise KeyboardInterrupt

    run = pipeline(act(interrupted))
    with pytest.raises(KeyboardInterrupt):
        run.feed(message())
    assert run.errors == {}


def test_rewriters_are_carried_out_in_order_and_told_how_often():
    told = []

    def rewriting(text):
        return act(
            lambda event: None,
            rewriter=lambda self, kind, key, payload: lambda each: each + text,
            rewrote=lambda self, key, count: told.append((text, key, count)),
        )

    run = pipeline(rewriting(b"1"), rewriting(b"2"), act(lambda event: None, topics="elsewhere"), provenance=False)
    run.start()
    assert run.rewriter("a", b"")(b"0") == b"012"
    run.rewrote("a", 5)
    assert told == [(b"1", "a", 5), (b"2", "a", 5)]
    assert run.counts["a"] == Counts(seen=5, changed=5, delivered=5)
    run.replace([rewriting(b"1"), act(lambda event: None)])
    assert run.rewriter("a", b"") is None  # the other one needs events
    assert run.rewriter("nobody/looks", b"") is None


def test_what_is_kept_by_key_and_topic_is_bounded(monkeypatch):
    monkeypatch.setattr(runner, "CACHED_KEYS", 2)
    monkeypatch.setattr(runner, "MOST_TOPICS", 3)
    run = pipeline()
    for number in range(6):
        run.feed(message(f"k{number}"))
        assert len(run._routes) <= 2
    assert {topic: counts.seen for topic, counts in run.counts.items()} == {
        "k0": 1, "k1": 1, "k2": 1, runner.OTHER_TOPICS: 3,
    }  # fmt: skip


def test_types_are_looked_up_again_when_they_have_been_forgotten():
    run = pipeline()
    before = run.route("a")
    assert run.route("a") is before
    run.forget()
    assert run.route("a") is not before
    assert run.route("a").counts is before.counts
