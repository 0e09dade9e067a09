from pathlib import Path

import pytest

from riot_bus.play.options import PlayOptions
from riot_bus.play.topic_selection import cast
from riot_bus.types.capabilities import Offer, RecordedTopic, SimClock
from riot_bus.types.model import Schema
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError
from riot_bus_mavlink.adapter import MavlinkAdapter
from riot_bus_ros2.adapter import Ros2Adapter
from tests.bags import LATCHED, STRING_HASH, STRING_KEY, VOLATILE

NOTHING = Schema("", "", b"")
STRING = Schema("std_msgs/msg/String", "ros2msg", b"string data\n")


class Middleware:
    """An adapter of another middleware: topics with a `!` are its own."""

    name = "middleware"

    def offer(self, topic, *, name, domain):
        if not topic.name.startswith("!"):
            return None
        return Offer((name or topic.name).strip("!"), depth=5 if "latched" in topic.details else None)

    def clock(self, topics, *, domain):
        return SimClock("!time", Offer("time"), lambda time: b"")


def own(*names):
    return [RecordedTopic(name, name, True, NOTHING, "json") for name in names]


def foreign(*names, **details):
    return [RecordedTopic(name, name, False, NOTHING, "json", details) for name in names]


def bag(*names, qos=VOLATILE):
    details = {"offered_qos_profiles": qos, "topic_type_hash": STRING_HASH}
    return [RecordedTopic(name, name, False, STRING, "cdr", details) for name in names]


def play(*logs, adapters=(), **options):
    return cast(logs, PlayOptions(logs=[Path("a.mcap")], **options), adapters)


def test_keys_are_played_as_they_are():
    found = play(own("a/x", "a/y"), own("a/y", "b"))
    assert found.keys == [{"a/x": "a/x", "a/y": "a/y"}, {"a/y": "a/y", "b": "b"}]
    assert set(found.offers) == set(found.names) == set(found.topics) == {"a/x", "a/y", "b"}
    assert found.clock is None


def test_topics_of_foreign_files_become_keys():
    assert play(foreign("/camera/image", "odom/")).keys == [{"/camera/image": "camera/image", "odom/": "odom"}]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"topics": ["a/x"]}, {"a/x"}),
        ({"topics": ["/a/x"]}, {"a/x"}),
        ({"topics": ["a/*"]}, {"a/x", "a/y"}),
        ({"topics": ["a/x", "b/**"]}, {"a/x", "b/c/d"}),
        ({"exclude": ["a/*"]}, {"b/c/d"}),
        ({"topics": ["**"], "exclude": ["**/x"]}, {"a/y", "b/c/d"}),
    ],
)
def test_selection(options, expected):
    assert set(play(own("a/x", "a/y", "b/c/d"), **options).offers) == expected


@pytest.mark.parametrize(
    ("remap", "expected"),
    [
        ("a/x:=new", {"a/x": "new", "a/y": "a/y"}),
        ("/a/x/:=/new/", {"a/x": "new", "a/y": "a/y"}),
        ("a/**:=b/c/**", {"a/x": "b/c/x", "a/y": "b/c/y"}),
    ],
)
def test_other_names(remap, expected):
    assert play(own("a/x", "a/y"), remap=[remap]).keys == [expected]


def test_short_names():
    keys = [f"mavlink_raw/fc/{name}" for name in ("1/1/HEARTBEAT", "1/1/PROTOCOL_VERSION", "9/1/HEARTBEAT")]
    adapters = [MavlinkAdapter("minimal")]
    options = {"topics": ["HEARTBEAT"], "exclude": ["9/*/HEARTBEAT"], "latched": ["1/1/HEARTBEAT=3"]}
    found = play(own(*keys), adapters=adapters, **options)
    assert {key: offer.depth for key, offer in found.offers.items()} == {keys[0]: 3}
    with pytest.raises(ConfigError, match="no topic '2/1/HEARTBEAT'"):
        play(own(*keys), adapters=adapters, topics=["2/1/HEARTBEAT"])


def test_other_names_for_ros():
    found = play(bag("/a/x", "/ab"), remap=["/a/**:=/replay/**"], domain=3, adapters=[Ros2Adapter()])
    assert found.keys == [{"/a/x": f"3/replay/x/{STRING_KEY}", "/ab": f"3/ab/{STRING_KEY}"}]
    assert found.names == {f"3/replay/x/{STRING_KEY}": "/replay/x", f"3/ab/{STRING_KEY}": "/ab"}


def test_what_is_named_must_be_there():
    for options in ({"topics": ["a/z"]}, {"exclude": ["a/z"]}, {"latched": ["a/z"]}, {"remap": ["a/z:=b"]}):
        with pytest.raises(ConfigError, match="no topic 'a/z'") as error:
            play(own("a/x"), **options)
        assert error.value.where == f"--{next(iter(options))}"
        assert error.value.hint == "did you mean 'a/x'?"


def test_nothing_is_left():
    with pytest.raises(ConfigError, match="nothing is left"):
        play(own("a/x"), exclude=["a/*"])
    assert play([]).keys == [{}]


def test_names_that_cannot_be_published_to():
    with pytest.raises(ConfigError, match="cannot be published") as error:
        play(own("a/x"), remap=["a/x:=b/*"])
    assert error.value.where == "a/x"
    with pytest.raises(ConfigError, match="not a key expression") as error:
        play(foreign("/with#hash"))
    assert (error.value.where, "--exclude" in error.value.hint) == ("/with#hash", True)
    assert play(foreign("/with#hash", "/b"), exclude=["/with#hash"]).keys == [{"/b": "b"}]


def test_latched_as_recorded_or_as_wanted():
    found = play(bag("/map", "/odom", qos=LATCHED), latched=["/map=7"], adapters=[Ros2Adapter()])
    assert {found.names[key]: offer.depth for key, offer in found.offers.items()} == {"/map": 7, "/odom": 2}
    assert play(own("a"), latched=["a"]).offers["a"].depth == 1


def test_of_several_logs_one_has_it_latched():
    logs = [foreign("!a", "!b"), foreign("!a", "!b", latched="")]
    for order in (logs, logs[::-1]):
        found = play(*order, adapters=[Middleware()])
        assert {key: offer.depth for key, offer in found.offers.items()} == {"a": 5, "b": 5}


def test_adapters_are_asked_in_their_order():
    found = play(foreign("!a", "b"), adapters=[Ros2Adapter(), Middleware()])
    assert found.keys == [{"!a": "a", "b": "b"}]


def test_our_clock_takes_the_place_of_the_recorded_one():
    found = play(bag("/clock", "/odom"), clock=40.0, adapters=[Ros2Adapter()])
    assert list(found.keys[0]) == ["/odom"]
    assert found.clock.name == "/clock"
    assert list(play(bag("/clock", "/odom"), adapters=[Ros2Adapter()]).keys[0]) == ["/clock", "/odom"]
    renamed = play(bag("/clock", "/odom"), clock=40.0, remap=["/clock:=/old_clock"], adapters=[Ros2Adapter()])
    assert list(renamed.keys[0]) == ["/clock", "/odom"]


def test_ros_needs_what_knows_ros():
    with pytest.raises(MissingExtraError, match="rosbags"):
        play(bag("/odom"))
    with pytest.raises(MissingExtraError, match="rosbags"):
        play(own("a"), clock=40.0)


def test_requests_and_replies_are_left_out():
    calls = own("a/x", "calc/add/@request", "calc/add/@reply", "calc/add/@error")
    assert play(calls).keys == [{"a/x": "a/x"}]
    with pytest.raises(ConfigError, match="nothing is left to play"):
        play(calls[1:])
    with pytest.raises(ConfigError, match="are not played: calc/add/@request"):
        play(calls, topics=["calc/add/@request"])
    assert play(calls, exclude=["calc/add/@request"]).keys == [{"a/x": "a/x"}]
