import pytest

pytest.importorskip("mcap_ros2")

from riot_bus.errors import PayloadError
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.attachment import parse_attachment
from riot_bus_ros2.definitions import DefinitionError, fields_of, parse_msg
from riot_bus_ros2.hashes import BASE_IDS, BOUNDED, COLLECTIONS, NESTED
from riot_bus_ros2.keys import DataKey, build_data_key
from riot_bus_ros2.live import SERVICE, described, question, services_of
from riot_bus_ros2.store import TypeStore
from riot_bus_ros2.tokens import Endpoint, Node, build_token
from tests.ros2_messages import encode

STORE = TypeStore()
LINE = "=" * 80
TEXT = f"""string<=5[<=3] a
wstring<=7 b
Inner[2] c
int8[] d
Nothing e
{LINE}
MSG: pkg/Inner
float64 x
{LINE}
MSG: pkg/Nothing
"""
NAME = "pkg/msg/Outer"
OWN = TypeStore(parse_msg(TEXT, NAME))
HASH = OWN.type_hash(NAME)


def field(field):
    base = NESTED if field.is_message else (BOUNDED if field.most_bytes else BASE_IDS)[field.content]
    kind = "array" if field.length is not None else "bounded" if field.most else "sequence"
    return {
        "name": field.name,
        "type": {
            "type_id": base + (COLLECTIONS[kind] if field.is_array else 0),
            "capacity": field.length or field.most,
            "string_capacity": field.most_bytes,
            "nested_type_name": field.content if field.is_message else "",
        },
    }


def description(name, store):
    """A node's description; rosidl gives messages without fields a placeholder."""
    placeholder = {"name": "structure_needs_at_least_one_member", "type": {"type_id": BASE_IDS["uint8"]}}
    parts = [
        {"type_name": each, "fields": [field(one) for one in fields_of(definition)] or [placeholder]}
        for each, definition in store.closure(name).items()
    ]
    return {"type_description": parts[0], "referenced_type_descriptions": parts[1:]}


def reply(name=NAME, store=OWN, **changes):
    document = {"successful": True, "failure_reason": "", "type_description": description(name, store)}
    return encode(f"{SERVICE}_Response", document | changes)


def test_a_description():
    found = described(reply(), NAME, HASH, STORE)
    assert TypeStore(found).type_hash(NAME) == HASH
    assert list(fields_of(found[NAME])) == OWN.fields(NAME)


@pytest.mark.parametrize("name", ["nav_msgs/msg/Odometry", "rcl_interfaces/srv/SetParameters", "std_msgs/msg/Empty"])
def test_descriptions_of_types_that_are_known(name):
    found = described(reply(name, STORE), name, STORE.type_hash(name), TypeStore())
    assert set(found) == set(STORE.closure(name))


def test_a_node_that_does_not_know():
    with pytest.raises(DefinitionError, match="does not know: absent"):
        described(reply(successful=False, failure_reason="absent"), NAME, HASH, STORE)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda parts: parts["referenced_type_descriptions"].pop(), "not complete"),
        (lambda parts: parts["type_description"].update(type_name="pkg/msg/Other"), "not complete"),
        (lambda parts: parts["type_description"]["fields"].pop(0), "another hash"),
        (lambda parts: parts["type_description"]["fields"][0].update(name="a b"), "is no name"),
        (lambda parts: parts["type_description"]["fields"][0]["type"].update(type_id=99), "another hash"),
        (lambda parts: parts["type_description"]["fields"][0]["type"].update(type_id=255), "unknown number"),
        (lambda parts: parts["type_description"]["fields"][2]["type"].update(nested_type_name="x\ny"), "is no name"),
    ],
)
def test_descriptions_that_are_not_believed(change, problem):
    parts = description(NAME, OWN)
    change(parts)
    with pytest.raises(DefinitionError, match=problem):
        described(reply(type_description=parts), NAME, HASH, STORE)


def test_bytes_that_are_no_reply():
    for data in (b"", b"\0\1\0\0", b"\0\1\0\0\1\0\0\0\xff\xff\xff\xff", reply()[:-20]):
        with pytest.raises(PayloadError):
            described(data, NAME, HASH, STORE)


def test_a_question():
    request = Ros2Adapter().type_named(f"{SERVICE}_Request")
    payload = question(NAME, HASH, STORE)
    assert [leaf.value for leaf in request.leaves(payload)] == [NAME, HASH, False]


def endpoint(node, kind, topic, type_name, type_hash):
    return Endpoint(Node(0, "abc", 1, node), 2, kind, topic, type_name, type_hash)


TALKER = endpoint("/robot/talker", "MP", "/odd", NAME, HASH)
TOKENS = [
    build_token(each)
    for each in (
        TALKER,
        endpoint("/robot/talker", "SS", "/robot/talker/get_type_description", SERVICE, STORE.type_hash(SERVICE)),
        endpoint("/other", "SS", "/other/get_type_description", SERVICE, STORE.type_hash(SERVICE)),
        endpoint("/other", "MP", "/chatter", "std_msgs/msg/String", "RIHS01_" + "0" * 64),
        Node(0, "abc", 1, "/robot/talker"),
    )
] + ["no token", "@ros2_lv/0/x"]


def test_the_services_of_nodes_that_use_a_key():
    expected = build_data_key(DataKey(0, "/robot/talker/get_type_description", SERVICE, STORE.type_hash(SERVICE)))
    assert services_of(TALKER.key, TOKENS) == [expected]
    assert services_of("0/absent/a::msg::dds_::B_/TypeHashNotSupported", TOKENS) == []


def test_an_adapter_learns_a_type():
    adapter, asked = Ros2Adapter(), []

    def ask(key, payload, attachment):
        asked.append(key)
        parse_attachment(attachment)
        return [b"no reply", reply()]

    assert adapter.type_of_key(TALKER.key) is None
    kind = adapter.learn(TALKER.key, TOKENS, ask)
    assert asked == services_of(TALKER.key, TOKENS)
    assert kind.type_hash == HASH
    assert adapter.type_of_key(TALKER.key) is kind
    assert adapter.type_named(NAME) is not None
    assert "wstring" in kind.opaque(b"\0\1\0\0" + bytes(50))


def test_an_adapter_that_learns_nothing():
    adapter = Ros2Adapter()
    assert adapter.learn(TALKER.key, TOKENS, lambda *_: [b"no reply"]) is None
    assert adapter.learn(TALKER.key, [], lambda *_: pytest.fail("nobody to ask")) is None
    assert adapter.learn("demo/odom", TOKENS, lambda *_: pytest.fail("no ROS key")) is None
