from __future__ import annotations

import pytest

from riot_bus.types.capabilities import ParsesTokens, PublishesAs, ReadsMetadata, RecordedTopic
from riot_bus.types.model import Schema, TopicName
from riot_bus.types.registry import TypeRegistry, chosen_adapters, load_adapters
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_ros2.cdr import CdrType
from riot_bus_ros2.qos import parse_offered
from riot_bus_ros2.ros2dds_adapter import Ros2DdsAdapter
from tests.bags import LATCHED, STRING_HASH, STRING_KEY

ODOM = "@/3f/@ros2_lv/MP/odom/nav_msgs§msg§Odometry/:1:0:0,10:typehash=RIHS01_ab;"
STRING = Schema("std_msgs/msg/String", "ros2msg", b"string data\n")


def recorded(name: str, key: str, *, keyed: bool, schema: Schema = STRING) -> RecordedTopic:
    details = {"offered_qos_profiles": LATCHED, "topic_type_hash": STRING_HASH}
    return RecordedTopic(name, key, keyed, schema, "cdr", details)


@pytest.fixture
def adapter() -> Ros2DdsAdapter:
    return Ros2DdsAdapter()


def test_it_is_loaded_only_where_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "ros2dds" not in [each.name for each in load_adapters()]
    assert [each.name for each in load_adapters(["ros2dds"])] == ["ros2dds"]
    monkeypatch.setenv("RIOT_ADAPTERS", "ros2, ros2dds:/bot1")
    assert [each.name for each in load_adapters()] == ["ros2", "ros2dds"]
    assert load_adapters()[1].key_expression("/odom") == "bot1/odom"
    assert chosen_adapters(["ros2"]) == ["ros2", "ros2dds:/bot1"]
    monkeypatch.setenv("RIOT_ADAPTERS", "")
    assert chosen_adapters(["ros2"]) == ["ros2"]
    assert chosen_adapters() is None
    with pytest.raises(ConfigError, match="'bot 1' is not a ROS namespace"):
        load_adapters(["ros2dds:bot 1"])
    with pytest.raises(ConfigError, match="adapter 'ros2' does not take '/bot1'"):
        load_adapters(["ros2:/bot1"])


def test_names_are_keys(adapter: Ros2DdsAdapter) -> None:
    assert isinstance(adapter, ParsesTokens)
    assert isinstance(adapter, PublishesAs)
    assert isinstance(adapter, ReadsMetadata)
    assert adapter.topic("robot/odom") == TopicName("/robot/odom")
    assert adapter.key_expression("/robot/odom") == "robot/odom"
    assert adapter.key_expression("/robot/**") == "robot/**"
    assert adapter.topic("robot/**") == TopicName("/robot/**")
    assert adapter.key_expression("robot/odom") is None
    for key in ("@riot/router/status", "a b", f"0/chatter/{STRING_KEY}", ""):
        assert adapter.topic(key) is None


def test_types_are_those_that_bridges_announce() -> None:
    registry = TypeRegistry([Ros2DdsAdapter()])
    assert registry.type_of("odom") is None
    assert registry.topic("odom") == "/odom"
    found = registry.announcement(ODOM)
    assert found is not None
    assert (found.topic, found.role) == ("/odom", "publishes")
    kind = registry.type_of("odom")
    assert kind is not None
    assert kind.name == "nav_msgs/msg/Odometry"
    assert registry.matches("/odom", "odom")
    assert not registry.matches("/odom", "robot/odom")
    registry.announcement("@/3f/@ros2_lv/MP/odd/my_msgs§msg§Odd/:::")
    assert registry.type_of("odd") is None
    adapter = registry.metadata_adapter("odd")
    assert adapter is not None
    assert adapter.definition("odd") == (Schema("my_msgs/msg/Odd", "ros2msg", b""), "cdr")
    assert adapter.definition("never/heard") is None
    assert adapter.stamp(bytes(33)) is None


def test_a_type_has_the_hash_that_its_publishers_announce(adapter: Ros2DdsAdapter) -> None:
    odometry = adapter.type_named("nav_msgs/msg/Odometry")
    assert isinstance(odometry, CdrType)
    listener = "@/3f/@ros2_lv/MS/odom/nav_msgs§msg§Odometry/:1:0:0,10"
    adapter.announcement(ODOM.replace("RIHS01_ab", odometry.type_hash))
    adapter.announcement(listener)  # of a node that does not know hashes
    assert adapter.type_of_key("odom") is odometry
    adapter.announcement(ODOM)
    kind = adapter.type_of_key("odom")
    assert kind is not None
    assert "another one than the key's" in str(kind.opaque(b"\0\1\0\0" + bytes(800)))
    adapter.announcement("@/3f/@ros2_lv/MP/odom/std_msgs§msg§Empty/:::")
    assert adapter.type_of_key("odom") is adapter.type_named("std_msgs/msg/Empty")
    adapter.announcement(listener.replace("odom/", "other/"))
    assert adapter.type_of_key("other") is odometry


def test_parts_of_actions_have_types(adapter: Ros2DdsAdapter) -> None:
    adapter.announcement("@/3f/@ros2_lv/AS/dock/nav_msgs§action§Dock")
    assert adapter.topic("dock/_action/feedback") == TopicName(
        "/dock/_action/feedback", "nav_msgs/action/Dock_FeedbackMessage"
    )
    assert adapter.topic("dock/_action/status") == TopicName("/dock/_action/status", "action_msgs/msg/GoalStatusArray")


def test_declared_types_count_for_names() -> None:
    registry = TypeRegistry([Ros2DdsAdapter("/bot1")], declared={"/odom": "nav_msgs/msg/Odometry"})
    assert registry.topic("bot1/odom") == "/odom"
    kind = registry.type_of("bot1/odom")
    assert kind is not None
    assert kind.name == "nav_msgs/msg/Odometry"
    assert registry.topic("bot2/odom") == "/bot2/odom"


def test_quality_and_hash_are_those_of_the_publishers(adapter: Ros2DdsAdapter) -> None:
    other = ODOM.replace("/odom/", "/other/")
    listener = ODOM.replace("/MP/", "/MS/").replace("0,10", "0,99")
    found = adapter.details("odom", [ODOM, other, listener, "nonsense"])
    assert found["topic_type_hash"] == "RIHS01_ab"
    assert found["offered_qos_profiles"].count("- history:") == 1
    assert parse_offered(found["offered_qos_profiles"]).depth == 10
    assert adapter.details("odom", []) == {"topic_type_hash": ""}


@pytest.mark.parametrize(
    "topic",
    [
        recorded("/map", "/map", keyed=False),
        recorded("/map", f"0/map/{STRING_KEY}", keyed=True),
        recorded("/map", "map", keyed=True),
    ],
)
def test_what_is_played_takes_the_way_of_a_bridge(adapter: Ros2DdsAdapter, topic: RecordedTopic) -> None:
    offer = adapter.offer(topic, name=None, domain=7)
    assert offer is not None
    assert (offer.key, offer.depth, offer.reliable) == ("map", 2, True)
    assert offer.identify is not None
    identity = offer.identify("3f", 1)
    assert identity.tokens == (
        "@/3f/@ros2_lv",
        f"@/3f/@ros2_lv/MP/map/std_msgs§msg§String/:1:1:0,2:typehash={STRING_HASH};",
    )
    assert identity.attachment is not None
    assert identity.attachment(b"recorded", 1, 2) is None
    renamed = adapter.offer(topic, name="/replay/map", domain=None)
    assert renamed is not None
    assert renamed.key == "replay/map"
    with pytest.raises(ConfigError, match="not the name of a ROS topic"):
        adapter.offer(topic, name="/a b", domain=None)


def test_what_is_no_message_of_ros_is_not_offered(adapter: Ros2DdsAdapter) -> None:
    assert adapter.offer(recorded("x", "x", keyed=True, schema=Schema("", "", b"")), name=None, domain=None) is None


def test_clock(adapter: Ros2DdsAdapter) -> None:
    clock = adapter.clock([], domain=None)
    assert (clock.name, clock.offer.key) == ("/clock", "clock")
    kind = adapter.type_named("rosgraph_msgs/msg/Clock")
    assert kind is not None
    assert kind.read(clock.payload(7_000_000_005), "clock.sec") == 7
