import pytest

from riot_bus.types.capabilities import PublishesAs, RecordedTopic
from riot_bus.types.model import Schema
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.attachment import Attachment, build_attachment, parse_attachment
from riot_bus_ros2.gid import gid_of
from tests.bags import LATCHED, STRING_HASH, STRING_KEY, VOLATILE

STRING = Schema("std_msgs/msg/String", "ros2msg", b"string data\n")


@pytest.fixture(scope="module")
def adapter():
    return Ros2Adapter()


def of_bag(name="/chatter", schema=STRING, encoding="cdr", qos=VOLATILE, type_hash=STRING_HASH):
    details = {"offered_qos_profiles": qos, "topic_type_hash": type_hash}
    return RecordedTopic(name, name, False, schema, encoding, details)


def of_bus(key, qos=""):
    return RecordedTopic(
        f"/{key.split('/')[1]}", key, True, STRING, "cdr", {"offered_qos_profiles": qos} if qos else {}
    )


def offer(adapter, topic, name=None, domain=None):
    return adapter.offer(topic, name=name, domain=domain)


def test_it_is_an_offering(adapter):
    assert isinstance(adapter, PublishesAs)


def test_topic_of_a_bag_gets_the_key_of_rmw_zenoh(adapter, monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    found = offer(adapter, of_bag())
    assert (found.key, found.depth, found.reliable, found.block) == (f"0/chatter/{STRING_KEY}", None, True, False)
    assert offer(adapter, of_bag("/robot/one/chatter")).key == f"0/robot/one/chatter/{STRING_KEY}"
    assert offer(adapter, of_bag("chatter")).key == f"0/chatter/{STRING_KEY}"


def test_domain_and_name(adapter, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    assert offer(adapter, of_bag()).key.startswith("7/chatter/")
    assert offer(adapter, of_bag(), name="/replay/chatter", domain=3).key == f"3/replay/chatter/{STRING_KEY}"
    monkeypatch.setenv("ROS_DOMAIN_ID", "seven")
    with pytest.raises(ConfigError, match="'seven' is not a ROS domain"):
        offer(adapter, of_bag())
    with pytest.raises(ConfigError, match="-1 is not a ROS domain"):
        offer(adapter, of_bag(), domain=-1)


def test_key_of_the_bus_is_kept(adapter):
    key = f"5/chatter/{STRING_KEY}"
    assert offer(adapter, of_bus(key)).key == key
    assert offer(adapter, of_bus(key), name="other", domain=0).key == f"0/other/{STRING_KEY}"
    assert offer(adapter, of_bus(f"{key}/_buf_cpu")).key == key
    humble = "0/chatter/std_msgs::msg::dds_::String_/TypeHashNotSupported"
    assert offer(adapter, of_bus(humble)).key == humble


@pytest.mark.parametrize(
    "topic",
    [
        of_bus("rover/odom"),
        of_bag(encoding="json"),
        of_bag(schema=Schema("", "", b"")),
        of_bag(schema=Schema("std_msgs/msg/String", "jsonschema", b"{}")),
        of_bag(schema=Schema("String", "ros2msg", b"string data")),
    ],
)
def test_what_is_no_ros_topic(adapter, topic):
    assert offer(adapter, topic) is None


@pytest.mark.parametrize("name", ["/with space", "/with-dash", "/", "/a//b", "/a/*"])
def test_names_that_ros_does_not_have(adapter, name):
    with pytest.raises(ConfigError, match="not the name of a ROS topic"):
        offer(adapter, of_bag(name))


def test_hash_is_that_of_the_definition_if_the_bag_has_none(adapter):
    assert offer(adapter, of_bag(type_hash="")).key == f"0/chatter/{STRING_KEY}"
    assert offer(adapter, of_bag(type_hash="nonsense/../x")).key == f"0/chatter/{STRING_KEY}"
    foreign = Schema("foreign_msgs/msg/Odd", "ros2msg", b"foreign_msgs/Unknown x\n")
    key = offer(adapter, of_bag(schema=foreign, type_hash="")).key
    assert key == "0/chatter/foreign_msgs::msg::dds_::Odd_/TypeHashNotSupported"


def test_services_events_keep_their_type(adapter):
    schema = Schema("example_interfaces/srv/AddTwoInts_Event", "ros2msg", b"cannot be parsed\n---\n")
    key = offer(adapter, of_bag("/add/_service_event", schema=schema, type_hash="RIHS01_ab")).key
    assert key == "0/add/_service_event/example_interfaces::srv::dds_::AddTwoInts_Event_/RIHS01_ab"


def test_latched_topics_stay_latched(adapter):
    found = offer(adapter, of_bag(qos=LATCHED))
    assert (found.depth, found.reliable) == (2, True)
    assert found.identify("abc", 3).tokens[1].endswith("/:1:,2:,:,:,,")


def test_reliable_and_keep_all_blocks(adapter):
    assert offer(adapter, of_bag(qos="- history: keep_all\n  reliability: reliable\n")).block
    assert not offer(adapter, of_bag(qos="- history: keep_all\n  reliability: best_effort\n")).block


def test_tokens_and_attachments_are_those_of_a_node(adapter):
    identity = offer(adapter, of_bag("/robot/chatter")).identify("1f2e", 4)
    assert identity.tokens == (
        "@ros2_lv/0/1f2e/0/0/NN/%/%/riot_play",
        f"@ros2_lv/0/1f2e/0/4/MP/%/%/riot_play/%robot%chatter/{STRING_KEY}/::,10:,:,:,,",
    )
    gid = gid_of(identity.tokens[1])
    assert parse_attachment(identity.attachment(None, 1, 5)) == Attachment(1, 5, gid)
    old = build_attachment(Attachment(77, 88, bytes(16), 1))
    assert parse_attachment(identity.attachment(old, 2, 6)) == Attachment(2, 6, gid, 1)
    assert identity.attachment(b"spoilt on purpose", 3, 7) == b"spoilt on purpose"


def test_two_sessions_are_two_publishers(adapter):
    found = offer(adapter, of_bag())
    gids = {parse_attachment(found.identify(zid, 1).attachment(None, 1, 0)).gid for zid in ("1a", "1b")}
    assert len(gids) == 2


def test_clock_is_told_where_the_topics_are(adapter, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "9")
    clock = adapter.clock([], domain=None)
    assert clock.name == "/clock"
    assert clock.offer.key.startswith("9/clock/rosgraph_msgs::msg::dds_::Clock_/RIHS01_")
    recorded = [of_bus("rover/odom"), of_bus(f"5/chatter/{STRING_KEY}")]
    assert adapter.clock(recorded, domain=None).offer.key.startswith("5/clock/")
    assert adapter.clock(recorded, domain=2).offer.key.startswith("2/clock/")
    humble = [of_bus("0/chatter/std_msgs::msg::dds_::String_/TypeHashNotSupported")]
    assert (
        adapter.clock(humble, domain=None).offer.key == "0/clock/rosgraph_msgs::msg::dds_::Clock_/TypeHashNotSupported"
    )


@pytest.mark.parametrize(
    ("time", "expected"),
    [(1_700_000_000_000_000_007, (1_700_000_000, 7)), (-5, (0, 0)), (2**64, (2**31 - 1, 709551616))],
)
def test_clock_tells_the_time(adapter, time, expected):
    clock = adapter.clock([], domain=0)
    kind = adapter.type_named("rosgraph_msgs/msg/Clock")
    payload = clock.payload(time)
    assert (kind.read(payload, "clock.sec"), kind.read(payload, "clock.nanosec")) == expected
