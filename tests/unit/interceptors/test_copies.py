import pytest

from riot_bus.interceptors.copies import Duplicate, Tee
from riot_bus.interceptors.timing import Delay
from riot_bus.pipeline.runner import Counts, Pipeline
from riot_bus.types.model import TopicName
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message


def test_duplicate_at_once(bench):
    run = bench(Duplicate(2))
    run.feed(1.0)
    assert run.times() == [1.0] * 3
    assert run.pipeline.counts["a"] == Counts(seen=1, copies=2, delivered=3)


def test_duplicates_follow_each_other_after_the_original(bench):
    run = bench(Delay(1.0), Duplicate(2, spacing=0.25))
    run.feed(0.0)
    assert run.times() == [1.0, 1.25, 1.5]
    assert run.payloads() == [b'{"x": 1.5}'] * 3


@pytest.mark.parametrize("wrong", [{"copies": 0}, {"spacing": -1}, {"spacing": float("nan")}])
def test_duplicate_refuses(wrong):
    with pytest.raises(ConfigError):
        Duplicate(**wrong)


def test_tee_copies_as_late_as_the_original(bench):
    run = bench(Delay(0.5), Tee("copy/{key}"))
    original = run.feed(1.0, key="a/b", attachment=b"z").original
    assert run.times() == [1.5, 1.5]
    assert run.delivered[0].message is original
    assert run.delivered[1].message == original.with_(key="copy/a/b")


def test_tee_knows_the_topic():
    class Adapter:
        name = "{key}"

        def topic(self, key):
            return TopicName("/odom{key}")

        def key_expression(self, topic):
            return None

    pipeline = Pipeline([Tee("copy/{topic}")], registry=TypeRegistry([Adapter()]))
    assert pipeline.feed(Message(0, "0/odom/x", b"")).emissions[1].message.key == "copy/odom{key}"


@pytest.mark.parametrize("key", ["copy/a/@request", "{key}/@reply", "{topic}/@error"])
def test_tee_never_calls(key):
    with pytest.raises(ConfigError, match="call of a service"):
        Tee(key)


@pytest.mark.parametrize("part", ["@request", "@reply", "@error"])
def test_tee_publishes_parts_of_calls_and_repeats_none(part):
    pipeline = Pipeline([Tee("copy/{key}"), Tee("{key}"), Tee("copy/{key}/seen")], registry=TypeRegistry())
    key = f"calc/add/{part}"
    assert [each.message.key for each in pipeline.feed(Message(0, key, b"")).emissions] == [key, f"copy/{key}/seen"]
    (one, other) = pipeline.errors.values()
    assert (one.count, other.count) == (1, 1)
    error = one
    assert "would be a call of a service" in error.first
    assert "hint: write a key that ends otherwise" in error.first


@pytest.mark.parametrize("key", ["", "a//b", "/a", "a/", "a/*", "a/$*", "a?b", "a#b", "copy/{name}"])
def test_tee_refuses(key):
    with pytest.raises(ConfigError, match=r"is not a key|stands for nothing"):
        Tee(key)
