import json

import msgpack
import pytest

from riot_bus.types.json_type import JsonType
from riot_bus.types.model import Schema, TopicName
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError


class Toy(JsonType):
    def __init__(self, name):
        self.name = name


class ToyAdapter:
    """Keys `toy/<name>/<type>`; topics `/name`; knows the types it is given."""

    name = "toy"

    def __init__(self, *types):
        self.types = {each: Toy(each) for each in types}
        self.asked = []

    def topic(self, key):
        self.asked.append(key)
        prefix, *rest = key.split("/")
        return TopicName("/" + rest[0], rest[1]) if prefix == "toy" and len(rest) == 2 else None

    def key_expression(self, topic):
        return f"toy{topic}/*" if topic.startswith("/") else None

    def load(self, files):
        raise NotImplementedError

    def type_named(self, type_name):
        return self.types.get(type_name)

    def type_of_schema(self, schema):
        return Toy(schema.name) if schema.encoding == "toyschema" else None


@pytest.fixture
def toys():
    return TypeRegistry([ToyAdapter("T", "U")], declared={"/named": "U", "raw/**": "json"})


def test_topics(toys):
    assert toys.topic("toy/odom/T") == "/odom"
    assert toys.topic("plain/key") == "plain/key"


def test_topics_are_asked_for_once():
    adapter = ToyAdapter()
    types = TypeRegistry([adapter])
    for _ in range(3):
        types.topic("toy/odom/T")
        types.type_of("toy/odom/T")
        types.matches("/odom", "toy/odom/T")
    assert adapter.asked == ["toy/odom/T"]


def test_key_expressions(toys):
    assert toys.key_expression("/odom") == "toy/odom/*"
    assert toys.key_expression("plain/**") == "plain/**"


@pytest.mark.parametrize(
    ("pattern", "key", "answer"),
    [
        ("/odom", "toy/odom/T", True),
        ("/odom", "toy/other/T", False),
        ("/*", "toy/odom/T", True),
        ("toy/**", "toy/odom/T", True),
        ("plain/*", "plain/a", True),
        ("plain/*", "plain/a/b", False),
        ("/odom", "plain/odom", False),
    ],
)
def test_matches(toys, pattern, key, answer):
    assert toys.matches(pattern, key) is answer
    assert toys.matches(pattern, key) is answer


def test_declared_types_come_first(toys):
    assert toys.type_of("toy/named/T").name == "U"
    assert toys.type_of("raw/a/b", encoding="application/msgpack").name == "json"


def test_then_a_schema_of_a_log_for_the_key(toys):
    toys.add_schema("toy/odom/T", Schema("logged", "toyschema", b""), "toy")
    assert toys.type_of("toy/odom/T").name == "logged"


def test_then_the_type_in_the_key(toys):
    toys.add_schema("/odom", Schema("logged", "toyschema", b""), "toy")
    assert toys.type_of("toy/odom/T").name == "T"


def test_a_key_may_tell_more_than_a_name():
    adapter = ToyAdapter("T")
    adapter.type_of_key = {"toy/odom/T": Toy("T of this hash")}.get
    types = TypeRegistry([adapter])
    assert types.type_of("toy/odom/T").name == "T of this hash"
    assert types.type_of("toy/other/T").name == "T"


def test_then_a_schema_of_a_log():
    types = TypeRegistry([ToyAdapter()])
    assert types.type_of("toy/odom/X") is None
    assert types.add_schema("/odom", Schema("X", "toyschema", b""), "toy").name == "X"
    assert types.type_of("toy/odom/X", encoding="application/json").name == "X"
    assert types.type_named("X").name == "X"
    assert types.add_schema("plain", Schema("Y", "strange", b""), "strange") is None
    assert types.add_schema("plain", Schema("Y", "jsonschema", b""), "json").name == "json"
    assert types.type_of("plain").name == "json"


class Written(Toy):
    schema = Schema("T", "toyschema", b"text")


def test_a_log_without_a_definition_only_names_a_type():
    adapter = ToyAdapter("T")
    adapter.type_of_schema = lambda schema: Written("T by name")
    types = TypeRegistry([adapter])
    assert types.add_schema("toy/odom/T", Schema("T", "toyschema", b""), "toy").name == "T by name"
    assert types.type_of("toy/odom/T").name == "T"  # the key tells more: with ROS 2, the hash
    types.add_schema("odd", Schema("T", "toyschema", b""), "toy")
    assert types.type_of("odd").name == "T by name"
    types.add_schema("toy/odom/T", Schema("T", "toyschema", b"text"), "toy")
    assert types.type_of("toy/odom/T").name == "T by name"


class Learner(ToyAdapter):
    """Knows no types until somebody tells."""

    def missing(self, key):
        return key.startswith("toy/") and key.split("/")[2] not in self.types

    def learn(self, key, tokens, heard, ask):
        told = list(ask(key, b"question", *heard))
        if told != [b"answer"]:
            return None
        name = key.split("/")[2]
        self.types[name] = Toy(name)
        return self.types[name]


def test_types_that_others_tell():
    types = TypeRegistry([Learner()], declared={"/named": "json"})
    assert types.type_of("toy/odom/T") is types.type_of("toy/other/T") is None
    assert [types.missing(key) for key in ("toy/odom/T", "toy/named/T", "plain")] == [True, False, False]
    assert not types.learn("toy/odom/T", [], [b""], lambda *_: [])
    assert types.type_of("toy/odom/T") is None
    assert types.learn("toy/odom/T", [], [b""], lambda *_: [b"answer"])
    assert types.type_of("toy/odom/T").name == types.type_of("toy/other/T").name == "T"
    assert not types.missing("toy/other/T")
    assert not types.learn("toy/other/T", [], [b""], lambda *_: pytest.fail("it is known"))


def test_what_is_looked_up_while_somebody_tells_is_not_remembered():
    adapter = Learner()
    types = TypeRegistry([adapter])

    def too_late(type_name):
        found = ToyAdapter.type_named(adapter, type_name)
        types.learn("toy/odom/T", [], [b""], lambda *_: [b"answer"])
        return found

    adapter.type_named = too_late
    assert types.type_of("toy/odom/T") is None
    assert types.type_of("toy/odom/T").name == "T"


@pytest.mark.parametrize(
    ("encoding", "name"),
    [
        ("application/json", "json"),
        ("text/json", "json"),
        ("json", "json"),
        ("application/json;schema", "json"),
        ("application/msgpack", "msgpack"),
        ("application/cdr;T", "T"),
    ],
)
def test_then_the_encoding(toys, encoding, name):
    assert toys.type_of("some/key", encoding=encoding).name == name


@pytest.mark.parametrize("encoding", ["application/cdr", "application/protobuf", "application/cdr;Unknown"])
def test_a_foreign_encoding_forbids_inference(toys, encoding):
    assert toys.type_of("some/key", encoding=encoding, payload=b"{}") is None


@pytest.mark.parametrize(
    ("payload", "name"),
    [
        (b' {"a":1}', "json"),
        (b"[1,2]", "json"),
        (msgpack.packb({"a": 1}), "msgpack"),
        (msgpack.packb([1, "b"]), "msgpack"),
    ],
)
@pytest.mark.parametrize("encoding", ["", "zenoh/bytes", "text/plain"])
def test_then_the_payload(toys, payload, name, encoding):
    assert toys.type_of("some/key", payload=payload, encoding=encoding).name == name
    assert toys.type_of("some/key", encoding=encoding).name == name


@pytest.mark.parametrize("payload", [b"", b"12", b'"text"', b"{broken", b"\x93\x01", b"\x00\x01\x00\x00"])
def test_inference_waits_for_a_payload_that_tells(toys, payload):
    assert toys.type_of("some/key", payload=payload) is None
    assert toys.type_of("some/key", payload=json.dumps({"a": 1}).encode()).name == "json"
    assert toys.type_of("some/key", payload=payload).name == "json"


def test_unknown_declared_types_are_errors():
    with pytest.raises(ConfigError) as caught:
        TypeRegistry(declared={"/odom": "jsn"})
    assert "did you mean 'json'?" in str(caught.value)
    assert caught.value.where == "/odom"
    with pytest.raises(ConfigError, match="name its definition files"):
        TypeRegistry(declared={"/odom": "pkg/msg/Name"})


def test_type_named(toys):
    assert toys.type_named("T").name == "T"
    assert toys.type_named("T") is toys.type_named("T")
    assert toys.type_named("V") is None


def test_caches_are_bounded(monkeypatch):
    monkeypatch.setattr("riot_bus.types.registry.CACHED_KEYS", 10)
    types = TypeRegistry([ToyAdapter("T")])
    for index in range(100):
        assert types.type_of(f"toy/{index}/T").name == "T"
    assert len(types._settled) <= 10


def test_load_adapters_finds_the_built_in_ones():
    pytest.importorskip("rosbags")
    pytest.importorskip("pymavlink")
    assert [adapter.name for adapter in load_adapters()] == ["mavlink", "ros2"]
    assert [adapter.name for adapter in load_adapters(["ros2"])] == ["ros2"]
    assert load_adapters([]) == []


def test_adapters_of_others_are_found(plugin_package):
    module = plugin_package("class Toy:\n    name = 'toy'\n", "riot_bus.adapters", toy="Toy")
    assert [type(each).__module__ for each in load_adapters(["toy"])] == [module]
    assert "toy" in [each.name for each in load_adapters()]


def test_an_unknown_adapter():
    with pytest.raises(ConfigError, match="did you mean 'ros2'"):
        load_adapters(["ros"])


def test_a_broken_adapter(plugin_package):
    plugin_package("import no_such_module", "riot_bus.adapters", bad="X")
    with pytest.raises(ConfigError, match="'bad' cannot be loaded"):
        load_adapters()


def test_a_missing_extra_counts_only_when_named(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert "ros2" not in [adapter.name for adapter in load_adapters()]
    with pytest.raises(MissingExtraError, match=r"'\.\[ros2\]'"):
        load_adapters(["ros2"])
