import pytest

from riot_bus.types.model import Schema, TopicName
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, MissingExtraError, install_hint
from riot_bus_ros2 import adapter as adapter_module
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.sources import HUMBLE, from_distribution
from riot_bus_ros2.store import TypeStore

UPDATE = """# part of a map
std_msgs/Header header
int32 x
int32 y
uint32 width
uint32 height
int8[] data
"""
ODOM = "0/odom/nav_msgs::msg::dds_::Odometry_/TypeHashNotSupported"
HEADER = b"\x01\0\0\0\x02\0\0\0\x04\0\0\0map\0"
UPDATE_PAYLOAD = (
    b"\0\1\0\0" + HEADER + b"\xfe\xff\xff\xff" + b"\x05\0\0\0" + b"\x02\0\0\0" * 2 + b"\x04\0\0\0" + b"\xff\0\x64\x01"
)


def write(root, name, text):
    package, kind, short = name.split("/")
    file = root / package / kind / f"{short}.msg"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    return file


@pytest.fixture
def adapter():
    return Ros2Adapter()


def test_topics_and_key_expressions(adapter):
    assert adapter.topic(ODOM) == TopicName("/odom", "nav_msgs/msg/Odometry")
    assert adapter.topic("demo/odom") is None
    assert adapter.topic(adapter.key_expression("/odom")) == TopicName("/odom")
    assert adapter.key_expression("/odom") == "*/odom/$*::dds_::$*/*/**"
    assert adapter.key_expression("demo/odom") is None


def test_types_by_name(adapter):
    odometry = adapter.type_named("nav_msgs/msg/Odometry")
    assert odometry.name == "nav_msgs/msg/Odometry"
    assert adapter.type_named("nav_msgs/Odometry") is odometry
    for unknown in ("no_such/msg/Type", "json", "std_srvs/srv/Empty", "std_srvs/srv/No_Request", "", "a/b/c/d"):
        assert adapter.type_named(unknown) is None


def test_in_the_registry(adapter):
    types = TypeRegistry([adapter], declared={"/scan": "sensor_msgs/msg/LaserScan", "bridge/odom": "nav_msgs/Odometry"})
    assert types.topic(ODOM) == "/odom"
    assert types.type_of(ODOM).name == "nav_msgs/msg/Odometry"
    assert types.matches("/odom", ODOM)
    assert types.matches("/odom", ODOM + "/_buf_cpu")
    assert types.type_of("0/scan/a::msg::dds_::B_/TypeHashNotSupported").name == "sensor_msgs/msg/LaserScan"
    assert types.type_of("bridge/odom").name == "nav_msgs/msg/Odometry"
    assert types.type_of("0/x/a::msg::dds_::B_/TypeHashNotSupported", encoding="application/cdr") is None


def test_load_a_type_that_no_distribution_has(adapter, tmp_path):
    assert adapter.type_named("map_msgs/msg/OccupancyGridUpdate") is None
    adapter.load([write(tmp_path, "map_msgs/msg/OccupancyGridUpdate", UPDATE)])
    update = adapter.type_named("map_msgs/msg/OccupancyGridUpdate")
    assert {leaf.path: leaf.value for leaf in update.leaves(UPDATE_PAYLOAD)} == {
        "header.stamp.sec": 1,
        "header.stamp.nanosec": 2,
        "header.frame_id": "map",
        "x": -2,
        "y": 5,
        "width": 2,
        "height": 2,
        "len(data)": 4,
        "data[0]": -1,
        "data[1]": 0,
        "data[2]": 100,
        "data[3]": 1,
    }
    assert update.patch(UPDATE_PAYLOAD, {"x": -(1 << 31), "data[1]": 200}) == UPDATE_PAYLOAD.replace(
        b"\xfe\xff\xff\xff", b"\0\0\0\x80"
    ).replace(b"\xff\0\x64", b"\xff\xc8\x64")
    assert update.type_hash.startswith("RIHS01_")
    assert b"int8[] data" in update.schema.data
    longer = update.rebuild(UPDATE_PAYLOAD, {"header.frame_id": "odom"})
    assert update.read(longer, "header.frame_id") == "odom"
    assert update.read(longer, "data[2]") == 100


def test_load_a_directory_with_dependencies_in_any_order(adapter, tmp_path):
    write(tmp_path, "my_pkg/msg/Outer", "Inner[3] inner\nstd_msgs/Header header\n")
    write(tmp_path, "my_pkg/msg/Inner", "float32 x 1.5\nuint8 KIND=3\n")
    adapter.load([tmp_path])
    assert adapter.type_named("my_pkg/msg/Outer").read(b"\0\1\0\0" + b"\0" * 24, "inner[2].x") == 0


def test_a_loaded_type_overrides_the_distribution(adapter, tmp_path):
    assert adapter.type_named("std_msgs/msg/Bool").leaves(b"\0\1\0\0\1")[0].type == "bool"
    adapter.load([write(tmp_path, "std_msgs/msg/Bool", "int8 data\n")])
    assert adapter.type_named("std_msgs/msg/Bool").leaves(b"\0\1\0\0\1")[0].type == "int8"


def test_a_line_that_does_not_parse(adapter, tmp_path):
    file = write(tmp_path, "my_pkg/msg/Bad", "int32 a\n\n# fine\nint32 9b\nint32 e\n")
    with pytest.raises(ConfigError, match="cannot parse") as caught:
        adapter.load([file])
    assert caught.value.where == f"{file}:4"


def test_an_unknown_type_inside(adapter, tmp_path):
    file = write(tmp_path, "my_pkg/msg/Bad", "int32 a\ngeometry_msgs/Pont p\n")
    with pytest.raises(ConfigError, match="unknown type 'geometry_msgs/msg/Pont'") as caught:
        adapter.load([file])
    assert caught.value.where == f"{file}:2"
    assert "did you mean 'geometry_msgs/msg/Point'" in caught.value.hint


def test_files_in_the_wrong_place(adapter, tmp_path):
    misplaced = tmp_path / "Odd.msg"
    misplaced.write_text("int32 a\n")
    with pytest.raises(ConfigError, match="not a file in a layout"):
        adapter.load([misplaced])
    with pytest.raises(ConfigError, match="cannot read"):
        adapter.load([tmp_path / "pkg" / "msg" / "Absent.msg"])
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(ConfigError, match=r"no \.msg files"):
        adapter.load([empty])


def test_types_of_schemas(adapter):
    text = b"float32 x\nmy_pkg/Inner inner\n" + b"=" * 80 + b"\nMSG: my_pkg/Inner\nuint8 y\n"
    schema = Schema("my_pkg/msg/Outer", "ros2msg", text)
    outer = adapter.type_of_schema(schema)
    assert [leaf.path for leaf in outer.leaves(b"\0\1\0\0" + b"\0" * 5)] == ["x", "inner.y"]
    assert outer.schema == schema
    assert adapter.type_of_schema(schema) is outer
    assert adapter.type_named("my_pkg/msg/Outer") is None


def test_a_schema_overrides_the_distribution_for_its_log(adapter):
    old = adapter.type_of_schema(Schema("std_msgs/msg/Bool", "ros2msg", b"int8 data\n"))
    assert old.leaves(b"\0\1\0\0\1")[0].type == "int8"
    assert adapter.type_named("std_msgs/msg/Bool").leaves(b"\0\1\0\0\1")[0].type == "bool"


def test_an_idl_schema(adapter):
    text = b"module my_pkg { module msg { struct P { double x; }; }; };\n"
    idl = Schema("my_pkg/msg/P", "ros2idl", b"=" * 80 + b"\nIDL: my_pkg/msg/P\n" + text)
    assert adapter.type_of_schema(idl).read(b"\0\1\0\0" + b"\0" * 8, "x") == 0.0


@pytest.mark.parametrize(
    "schema",
    [
        Schema("a/msg/B", "jsonschema", b"{}"),
        Schema("a/msg/B", "ros2msg", b"int32 a\n---\nint32 b\n"),
        Schema("a/srv/B_Event", "ros2msg", b"int32 a\n---\nint32 b\n---\nint32 c\n"),
        Schema("a/msg/B", "ros2msg", b"\xff\xfe"),
        Schema("a/msg/B\nint32 x", "ros2msg", b"int32 a\n"),
        Schema("a/msg/B", "ros2idl", b"module {"),
        Schema("a/msg/B", "ros2msg", b""),
    ],
)
def test_schemas_that_are_not_understood(adapter, schema):
    assert adapter.type_of_schema(schema) is None


def test_an_empty_schema_counts_by_its_name(adapter):
    assert adapter.type_of_schema(Schema("std_msgs/msg/Bool", "ros2msg", b"")).name == "std_msgs/msg/Bool"


def test_without_rosbags(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match="'rosbags' is not installed") as caught:
        Ros2Adapter()
    assert caught.value.hint == install_hint("ros2")


def key_of(name, wanted, topic="x"):
    package, kind, short = name.split("/")
    return f"0/{topic}/{package}::{kind}::dds_::{short}_/{wanted}"


def test_a_key_names_a_type_with_its_hash(adapter):
    kind = adapter.type_named("nav_msgs/msg/Odometry")
    assert adapter.type_of_key(key_of(kind.name, kind.type_hash)) is kind
    assert adapter.type_of_key(key_of("no_such/msg/Type", kind.type_hash)) is None
    assert adapter.type_of_key("demo/odom") is None
    assert adapter.type_of_key(key_of("std_srvs/srv/SetBool", adapter.store.type_hash("std_srvs/srv/SetBool"))) is None
    feedback = "example_interfaces/action/Fibonacci_FeedbackMessage"
    found = adapter.type_of_key(key_of(feedback, adapter.store.type_hash(feedback)))
    paths = ["goal_id.uuid[*]", "len(feedback.sequence)", "feedback.sequence[*]"]
    assert [field.path for field in found.fields()] == paths


def test_a_key_with_another_hash_is_opaque(adapter):
    kind = adapter.type_of_key(key_of("std_msgs/msg/Bool", "RIHS01_" + "1" * 64))
    assert kind.name == "std_msgs/msg/Bool"
    assert "another one than the key's" in kind.opaque(b"\0\1\0\0\1")
    assert kind.schema.data == b""  # a log must not say otherwise
    assert adapter.type_named("std_msgs/msg/Bool").opaque(b"\0\1\0\0\1") is None


def test_a_log_without_a_definition_does_not_hide_the_hash_of_its_key(adapter):
    registry = TypeRegistry([adapter])
    empty = Schema("std_msgs/msg/Bool", "ros2msg", b"")
    key = key_of(empty.name, "RIHS01_" + "1" * 64)
    for place in (key, "/flag"):  # as riot_bus records an unknown version of a type, and as bags have it
        registry.add_schema(place, empty, "cdr")
    assert "another one than the key's" in registry.type_of(key).opaque(b"\0\1\0\0\1")
    assert registry.type_of("/flag").read(b"\0\1\0\0\1", "data") is True
    registry.add_schema(key, Schema(empty.name, "ros2msg", b"int8 data\n"), "cdr")
    assert registry.type_of(key).read(b"\0\1\0\0\5", "data") == 5


def test_types_of_invented_keys_are_not_kept_for_ever(adapter, monkeypatch):
    monkeypatch.setattr(adapter_module, "_CACHED", 5)
    adapter._forget()
    for number in range(20):
        assert adapter.type_of_key(key_of("no_such/msg/Type", f"RIHS01_{number:064x}")) is None
    assert adapter._hashed.cache_info().currsize <= 5


def test_a_key_with_the_hash_of_files_or_of_an_older_distribution(adapter, tmp_path):
    adapter.load([write(tmp_path, "std_msgs/msg/Bool", "int8 data\n")])
    loaded = adapter.type_named("std_msgs/msg/Bool")
    bundled = Ros2Adapter().type_named("std_msgs/msg/Bool")
    for expected in (loaded, bundled):
        kind = adapter.type_of_key(key_of("std_msgs/msg/Bool", expected.type_hash))
        assert kind.leaves(b"\0\1\0\0\1") == expected.leaves(b"\0\1\0\0\1")


def test_a_key_without_a_hash_comes_from_humble(adapter):
    humble = TypeStore(sources=(from_distribution(HUMBLE),))
    differing = next(
        name
        for name in humble.names()
        if humble.definition(name) is not None and humble.type_hash(name) != adapter.store.type_hash(name)
    )
    kind = adapter.type_of_key(key_of(differing, "TypeHashNotSupported"))
    assert kind.type_hash == humble.type_hash(differing)
    assert kind.type_hash != adapter.type_named(differing).type_hash


def test_parts_of_services_are_types(adapter):
    request = adapter.type_named("std_srvs/srv/SetBool_Request")
    assert request.read(b"\0\1\0\0\1", "data") is True
    assert adapter.type_named("std_srvs/srv/SetBool") is None
    assert adapter.type_named("tf2_msgs/action/LookupTransform") is None
    assert adapter.type_named("tf2_msgs/action/LookupTransform_SendGoal") is None
    assert adapter.type_named("tf2_msgs/action/LookupTransform_SendGoal_Request") is not None


def test_recorded_events_of_a_service(adapter):
    text = b"bool data\n---\nbool success\nstring message\n"
    kind = adapter.type_of_schema(Schema("std_srvs/srv/SetBool_Event", "ros2msg", text))
    assert kind.type_hash == adapter.store.type_hash("std_srvs/srv/SetBool_Event")
    assert next(field.high for field in kind.fields() if field.path == "len(request)") == 1


def test_a_type_that_is_unknown_has_a_name_at_least() -> None:
    found = Ros2Adapter().definition("0/x/my_msgs::msg::dds_::Odd_/TypeHashNotSupported")
    assert found is not None
    assert (found[0].name, found[0].data, found[1]) == ("my_msgs/msg/Odd", b"", "cdr")
    assert Ros2Adapter().definition("a/b") is None


def test_the_registry_finds_the_adapter_that_reads_attachments() -> None:
    key = "0/robot/chatter/std_msgs::msg::dds_::String_/RIHS01_df"
    token = "@ros2_lv/0/aa/0/1/MP/%/%/talker/%robot%chatter/std_msgs::msg::dds_::String_/RIHS01_df/::,5:,:,:,,"
    registry = TypeRegistry([Ros2Adapter()])
    adapter = registry.metadata_adapter(key)
    assert adapter is registry.metadata_adapters()[0]
    assert registry.metadata_adapter("a/b") is None
    assert adapter is not None
    assert adapter.stamp(b"") is None
    assert adapter.details(key, [token])
    assert adapter.definition(key) is not None
