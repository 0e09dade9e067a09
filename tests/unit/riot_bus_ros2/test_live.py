import pytest

pytest.importorskip("mcap_ros2")

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.attachment import Attachment, build_attachment, parse_attachment
from riot_bus_ros2.definitions import DefinitionError, fields_of, parse_msg
from riot_bus_ros2.gid import gid_of
from riot_bus_ros2.keys import DataKey, build_data_key
from riot_bus_ros2.live import SERVICE, described, question, services_of
from riot_bus_ros2.store import TypeStore
from riot_bus_ros2.tokens import Node, NodeEndpoint, build_token
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
    with pytest.raises(DefinitionError, match=r"does not know .*: absent"):
        described(told(successful=False, failure_reason="absent"), NAME, HASH, STORE)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda parts: parts["referenced_type_descriptions"].pop(), "not complete"),
        (lambda parts: parts["type_description"].update(type_name="pkg/msg/Other"), "not complete"),
        (lambda parts: parts["type_description"]["fields"].pop(0), "another hash"),
        (lambda parts: parts["type_description"]["fields"][0].update(name="a b"), "is not a name"),
        (lambda parts: parts["type_description"]["fields"][0]["type"].update(type_id=99), "another hash"),
        (lambda parts: parts["type_description"]["fields"][0]["type"].update(type_id=255), "unknown number"),
        (lambda parts: parts["type_description"]["fields"][2]["type"].update(nested_type_name="x\ny"), "is not a name"),
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
    return NodeEndpoint(Node(0, "abc", 1, node), 2, kind, topic, type_name, type_hash)


def node_of(name, *others):
    """A node that tells types, and what else it has."""
    return [
        Node(0, "abc", 1, name),
        endpoint(name, "SS", f"{name}/get_type_description", SERVICE, SERVICE_HASH),
        *others,
    ]


SERVICE_HASH = STORE.type_hash(SERVICE)
TALKER = endpoint("/robot/talker", "MP", "/odd", NAME, HASH)
OTHER = endpoint("/other", "MP", "/chatter", "std_msgs/msg/String", "RIHS01_" + "0" * 64)
TOKENS = [build_token(each) for each in (*node_of("/robot/talker", TALKER), *node_of("/other", OTHER))]
TOKENS += ["no token", "@ros2_lv/0/x"]
TELLS = build_data_key(DataKey(0, "/robot/talker/get_type_description", SERVICE, SERVICE_HASH))


def heard_of(publisher, version=2):
    return build_attachment(Attachment(5, 6, gid_of(build_token(publisher)), version))


HEARD = [heard_of(TALKER)]


@pytest.mark.parametrize("version", [1, 2])
def test_a_node_is_asked_as_it_speaks(version):
    assert services_of(TALKER.key, TOKENS, [b"nonsense", heard_of(TALKER, version)]) == {TELLS: version}
    assert services_of(TALKER.key, [each for each in TOKENS if "_type_desc" not in each], HEARD) == {}
    assert services_of("demo/odom", TOKENS, HEARD) == {}


def test_nobody_is_asked_who_might_speak_another_version():
    assert services_of(TALKER.key, TOKENS, []) == {}
    assert services_of(TALKER.key, TOKENS, [b"nonsense", bytes(33), bytes(77)]) == {}
    old = endpoint("/old", "MP", "/odd", NAME, HASH)
    tokens = [*TOKENS, *map(build_token, node_of("/old", old))]
    tells = TELLS.replace("robot/talker", "old")
    assert services_of(TALKER.key, tokens, HEARD) == {TELLS: 2}
    assert services_of(TALKER.key, tokens, [*HEARD, heard_of(old, 1)]) == {TELLS: 2, tells: 1}
    stranger = build_attachment(Attachment(5, 6, b"0123456789abcdef"))
    assert services_of(TALKER.key, tokens, [stranger]) == {}
    assert services_of(TALKER.key, TOKENS, [stranger]) == {TELLS: 2}  # there is nobody else
    assert services_of(TALKER.key, TOKENS, [stranger, build_attachment(Attachment(5, 6, bytes(16), 1))]) == {}


@pytest.mark.parametrize("version", [1, 2])
def test_an_adapter_learns_a_type(version):
    adapter, asked = Ros2Adapter(), []

    def ask(key, payload, attachment):
        asked.append((key, parse_attachment(attachment).version))
        return [b"no reply", told()]

    assert adapter.type_of_key(TALKER.key) is None
    assert adapter.missing(TALKER.key)
    kind = adapter.learn(TALKER.key, TOKENS, [heard_of(TALKER, version)], ask)
    assert asked == [(TELLS, version)]
    assert kind.type_hash == HASH
    assert adapter.type_of_key(TALKER.key) is kind
    assert not adapter.missing(TALKER.key)
    assert adapter.type_named(NAME).type_hash == HASH
    assert NAME in adapter.type_names()
    assert adapter.type_named("pkg/msg/Inner") is None  # it was told as a part of another type
    assert "wstring" in kind.opaque(b"\0\1\0\0" + bytes(50))


def test_an_adapter_that_learns_nothing():
    adapter = Ros2Adapter()
    assert adapter.learn(TALKER.key, TOKENS, HEARD, lambda *_: [b"no reply"]) is None
    assert adapter.learn(TALKER.key, [], HEARD, lambda *_: pytest.fail("nobody to ask")) is None
    assert adapter.learn(TALKER.key, TOKENS, [], lambda *_: pytest.fail("nobody was heard")) is None
    assert adapter.learn("demo/odom", TOKENS, HEARD, lambda *_: pytest.fail("no ROS key")) is None


def test_a_key_whose_type_is_missing():
    adapter = Ros2Adapter()
    string = adapter.type_named("std_msgs/msg/String")
    known = DataKey(0, "/x", string.name, string.type_hash)
    assert not adapter.missing(build_data_key(known))
    assert adapter.missing(build_data_key(DataKey(0, "/x", string.name, "RIHS01_" + "0" * 64)))  # another version
    assert not adapter.missing(build_data_key(DataKey(0, "/x", NAME)))  # Humble's nodes tell nothing
    assert not adapter.missing("demo/odom")
    assert not adapter.missing(build_data_key(DataKey(0, "/do", "pkg/srv/Do", HASH)))  # calls are not listened to


def test_two_versions_of_a_type_and_of_what_is_in_it():
    adapter = Ros2Adapter()
    versions = [
        TypeStore(parse_msg(f"Inner inner\n{LINE}\nMSG: pkg/Inner\n{each} x\n", NAME)) for each in ("int8", "float64")
    ]
    kinds = []
    for store in versions:
        talker = endpoint("/robot/talker", "MP", "/odd", NAME, store.type_hash(NAME))
        tokens = [build_token(talker), *TOKENS]
        kinds.append(adapter.learn(talker.key, tokens, [heard_of(talker)], lambda *_, store=store: [told(NAME, store)]))
        assert adapter.type_of_key(talker.key) is kinds[-1]
    assert [kind.fields()[0].type for kind in kinds] == ["int8", "float64"]
    for kind, store in zip(kinds, versions, strict=True):
        assert adapter.type_of_key(build_data_key(DataKey(0, "/other", NAME, store.type_hash(NAME)))).type_hash == (
            kind.type_hash
        )
    assert adapter.type_named(NAME).type_hash == kinds[-1].type_hash
