import pytest

pytest.importorskip("mcap_ros2")

from riot_bus.errors import PayloadError
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.attachment import parse_attachment
from riot_bus_ros2.definitions import DefinitionError, fields_of, parse_file, parse_msg
from riot_bus_ros2.keys import DataKey, build_data_key
from riot_bus_ros2.live import SERVICE, described, question, services_of
from riot_bus_ros2.store import TypeStore
from riot_bus_ros2.tokens import Endpoint, Node, build_token
from tests.type_descriptions import description, reply

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


def told(name=NAME, store=OWN, **changes):
    return reply(name, store, **changes)


def test_a_description():
    found = described(told(), NAME, HASH, STORE)
    assert TypeStore(found).type_hash(NAME) == HASH
    assert list(fields_of(found[NAME])) == OWN.fields(NAME)


@pytest.mark.parametrize("name", ["nav_msgs/msg/Odometry", "rcl_interfaces/srv/SetParameters", "std_msgs/msg/Empty"])
def test_descriptions_of_types_that_are_known(name):
    found = described(told(name, STORE), name, STORE.type_hash(name), TypeStore())
    assert set(found) == set(STORE.closure(name))


def test_a_node_that_does_not_know():
    with pytest.raises(DefinitionError, match="does not know: absent"):
        described(told(successful=False, failure_reason="absent"), NAME, HASH, STORE)


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
        described(told(type_description=parts), NAME, HASH, STORE)


def test_bytes_that_are_no_reply():
    for data in (b"", b"\0\1\0\0", b"\0\1\0\0\1\0\0\0\xff\xff\xff\xff", told()[:-20]):
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
        return [b"no reply", told()]

    assert adapter.type_of_key(TALKER.key) is None
    assert adapter.missing(TALKER.key)
    kind = adapter.learn(TALKER.key, TOKENS, ask)
    assert asked == services_of(TALKER.key, TOKENS)
    assert kind.type_hash == HASH
    assert adapter.type_of_key(TALKER.key) is kind
    assert not adapter.missing(TALKER.key)
    assert adapter.type_named(NAME).type_hash == HASH
    assert NAME in adapter.type_names()
    assert adapter.type_named("pkg/msg/Inner") is None  # it was told as a part of another type
    assert "wstring" in kind.opaque(b"\0\1\0\0" + bytes(50))


def test_an_adapter_that_learns_nothing():
    adapter = Ros2Adapter()
    assert adapter.learn(TALKER.key, TOKENS, lambda *_: [b"no reply"]) is None
    assert adapter.learn(TALKER.key, [], lambda *_: pytest.fail("nobody to ask")) is None
    assert adapter.learn("demo/odom", TOKENS, lambda *_: pytest.fail("no ROS key")) is None


def test_a_key_whose_type_is_missing():
    adapter = Ros2Adapter()
    string = adapter.type_named("std_msgs/msg/String")
    known = DataKey(0, "/x", string.name, string.type_hash)
    assert not adapter.missing(build_data_key(known))
    assert adapter.missing(build_data_key(DataKey(0, "/x", string.name, "RIHS01_" + "0" * 64)))  # another version
    assert not adapter.missing(build_data_key(DataKey(0, "/x", NAME)))  # Humble's nodes tell nothing
    assert not adapter.missing("demo/odom")


def test_two_versions_of_a_type_and_of_what_is_in_it():
    adapter = Ros2Adapter()
    versions = [
        TypeStore(parse_msg(f"Inner inner\n{LINE}\nMSG: pkg/Inner\n{each} x\n", NAME)) for each in ("int8", "float64")
    ]
    kinds = []
    for store in versions:
        talker = endpoint("/robot/talker", "MP", "/odd", NAME, store.type_hash(NAME))
        tokens = [build_token(talker), *TOKENS]
        kinds.append(adapter.learn(talker.key, tokens, lambda *_, store=store: [told(NAME, store)]))
        assert adapter.type_of_key(talker.key) is kinds[-1]
    assert [kind.fields()[0].type for kind in kinds] == ["int8", "float64"]
    for kind, store in zip(kinds, versions, strict=True):
        assert adapter.type_of_key(build_data_key(DataKey(0, "/other", NAME, store.type_hash(NAME)))).type_hash == (
            kind.type_hash
        )
    assert adapter.type_named(NAME).type_hash == kinds[-1].type_hash


def test_a_service_is_described_too():
    adapter = Ros2Adapter()
    name = "pkg/srv/Do"
    store = TypeStore(parse_file("int8 a\n---\nfloat64 b\n", name, ".srv"))
    server = endpoint("/robot/talker", "SS", "/do", name, store.type_hash(name))
    assert adapter.missing(server.key)
    assert adapter.type_of_key(f"{server.key}/@request") is None
    adapter.learn(server.key, [build_token(server), *TOKENS], lambda *_: [told(name, store)])
    assert adapter.type_of_key(f"{server.key}/@request").read(b"\0\1\0\0\5", "a") == 5
    assert [field.path for field in adapter.type_of_key(f"{server.key}/@reply").fields()] == ["b"]
