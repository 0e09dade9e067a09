import pytest

from riot_bus.types.listing import describe_named
from riot_bus.types.model import Schema, TopicName
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_mavlink.adapter import MavlinkAdapter
from riot_bus_mavlink.frame import pack_frame
from riot_bus_mavlink.keys import KeyTemplate, Parsed
from riot_bus_ros2.adapter import Ros2Adapter

KEY = "mavlink_raw/gcs/255/190/HEARTBEAT"
MINE = """<?xml version="1.0"?>
<mavlink>
  <include>minimal.xml</include>
  <enums><enum name="LAMP"><entry value="0" name="OFF"/><entry name="ON"/></enum></enums>
  <messages>
    <message id="54321" name="LAMP_STATE">
      <description>Of a lamp</description>
      <field type="uint8_t" name="state" enum="LAMP"/>
      <field type="float[3]" name="colour" units="%" minValue="0" maxValue="100"/>
      <extensions/>
      <field type="char[8]" name="label"/>
    </message>
  </messages>
</mavlink>
"""


def heartbeat():
    return pack_frame(0, bytes(range(1, 10)), 50, version=2, sequence=0, system=255, component=190)


def test_it_is_found_by_name_and_unasked():
    assert "mavlink" in [adapter.name for adapter in load_adapters()]
    (one,) = load_adapters(["mavlink:minimal"])
    assert len(one.type_names()) == 1
    with pytest.raises(ConfigError, match="unknown dialect 'minimum'") as error:
        load_adapters(["mavlink:minimum"])
    assert "'minimal'" in error.value.hint


def test_keys_name_types():
    registry = TypeRegistry([MavlinkAdapter()])
    assert registry.topic(KEY) == KEY
    kind = registry.type_of(KEY, payload=heartbeat())
    assert (kind.name, kind.read(heartbeat(), "header.system_id")) == ("mavlink/HEARTBEAT", 255)
    assert registry.type_of("mavlink_raw/gcs/255/190/UNKNOWN_77777", payload=heartbeat()) is None
    assert registry.type_of("mavlink/1/1/HEARTBEAT", payload=b'{"a":1}').name == "json"
    assert describe_named("heartbeat", registry).name == "mavlink/HEARTBEAT"


@pytest.mark.parametrize(
    ("topic", "expression"),
    [
        ("HEARTBEAT", "mavlink_raw/*/*/*/HEARTBEAT"),
        ("1/1/HEARTBEAT", "mavlink_raw/*/1/1/HEARTBEAT"),
        ("1/*/HEARTBEAT", "mavlink_raw/*/1/*/HEARTBEAT"),
        ("HEART", None),
        ("gcs/1/1/HEARTBEAT", None),
        (KEY, None),
        ("/odom", None),
        ("mavlink_raw/**", None),
    ],
)
def test_short_names(topic, expression):
    adapter = MavlinkAdapter()
    assert adapter.key_expression(topic) == expression
    assert TypeRegistry([adapter, Ros2Adapter()]).matches("HEARTBEAT", KEY)


def test_templates():
    one = KeyTemplate("drone7/{MESSAGE}/{sysid}")
    assert one.key("gcs", 1, 2, "ATTITUDE") == "drone7/ATTITUDE/1"
    assert one.parse("drone7/ATTITUDE/1") == Parsed("", 1, None, "ATTITUDE")
    assert one.parse("drone7/ATTITUDE/1/2") is None
    assert one.parse("drone7/ATTITUDE/999") is None
    assert one.expression() == "drone7/*/*"
    adapter = MavlinkAdapter("template=drone7/{MESSAGE}/{sysid};dialect=common")
    assert adapter.topic("drone7/ATTITUDE/1") == TopicName("drone7/ATTITUDE/1", "mavlink/ATTITUDE")
    assert KeyTemplate().parse(KEY) == Parsed("gcs", 255, 190, "HEARTBEAT")


@pytest.mark.parametrize(
    "text", ["", "a", "{MESSAGE}", "a/{sysid}", "a/{MESSAGE}/{MESSAGE}", "a//{MESSAGE}", "a*/{MESSAGE}", "a/x{MESSAGE}"]
)
def test_templates_that_are_none(text):
    with pytest.raises(ConfigError, match="template"):
        KeyTemplate(text)


@pytest.mark.parametrize("options", ["colour=red", "dialect=", "common;dialect=all", "key_file=/no/such/file"])
def test_options_that_are_none(options):
    with pytest.raises(ConfigError):
        MavlinkAdapter(options)


def test_definitions_of_the_user(tmp_path):
    file = tmp_path / "mine.xml"
    file.write_text(MINE)
    registry = TypeRegistry([MavlinkAdapter("common"), Ros2Adapter()], definitions=[file])
    kind = registry.type_named("mavlink/LAMP_STATE")
    assert registry.type_named("mavlink/ATTITUDE") is not None
    raw = pack_frame(
        54321, b"\0" * 12 + b"\1" + b"desk", kind.message.crc_extra, version=2, sequence=0, system=1, component=1
    )
    assert {leaf.path: leaf.value for leaf in kind.leaves(raw)[3:]} == {
        "state": 1, "colour[0]": 0.0, "colour[1]": 0.0, "colour[2]": 0.0, "label": "desk",
    }  # fmt: skip
    fields = {field.path: field for field in kind.fields()}
    assert (fields["state"].high, fields["colour[*]"].high, fields["colour[*]"].unit) == (1, 100, "%")
    alone = TypeRegistry([MavlinkAdapter("dialect=minimal")], definitions=[file])
    assert len(alone.type_names()) - len(TypeRegistry().type_names()) == 2


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("<mavlink>", "no element found"),
        ("<other/>", "<other>"),
        (MINE.replace("uint8_t", "byte"), "has type 'byte'"),
        (MINE.replace("54321", "16777216"), "not an id"),
        (MINE.replace("54321", "many"), "not an integer"),
        (MINE.replace('"colour"', '"state"'), "two fields are called 'state'"),
        (MINE.replace("float[3]", "float[64]"), "265 bytes of 255"),
        (MINE.replace("float[3]", "float[0]"), "has type"),
        (MINE.replace("LAMP_STATE", "LAMP STATE"), "has the name"),
        (MINE.replace('maxValue="100"', 'maxValue="lots"'), "not a number"),
        (MINE.replace("<mavlink>", '<!DOCTYPE x [<!ENTITY a "b">]><mavlink>', 1), "document type"),
        (MINE.replace("minimal.xml", "nowhere.xml"), "cannot be read"),
    ],
)
def test_definitions_that_are_wrong(tmp_path, text, why):
    file = tmp_path / "mine.xml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=why) as error:
        MavlinkAdapter("minimal").load([file])
    assert error.value.where


def test_encodings_that_are_none(tmp_path):
    file = tmp_path / "mine.xml"
    for encoding in ("klingon", "utf-32"):
        file.write_text(f'<?xml version="1.0" encoding="{encoding}"?>{MINE}')
        with pytest.raises(ConfigError, match=r"not a dialect of MAVLink: .*encoding"):
            MavlinkAdapter("minimal").load([file])


def test_files_that_include_each_other(tmp_path):
    for name, other in (("a", "b"), ("b", "a")):
        text = MINE.replace("minimal.xml", f"{other}.xml").replace("LAMP_STATE", f"LAMP_{name}")
        (tmp_path / f"{name}.xml").write_text(text.replace("54321", f"5432{len(name)}{ord(name)}"))
    adapter = MavlinkAdapter("minimal")
    adapter.load([tmp_path / "a.xml"])
    assert sorted(adapter.type_names()) == ["mavlink/HEARTBEAT", "mavlink/LAMP_a", "mavlink/LAMP_b"]
    with pytest.raises(ConfigError, match="cannot be read"):
        MavlinkAdapter().load([tmp_path / "c.xml"])


def test_every_definition_comes_back_from_a_log():
    adapter, bare = MavlinkAdapter(), MavlinkAdapter("test")
    for name in adapter.type_names():
        kind = adapter.type_named(name)
        assert adapter.type_of_schema(kind.schema) is kind
        again = bare.type_of_schema(kind.schema)
        assert (again.name, again.message) == (kind.name, kind.message)
        assert again.fields() == kind.fields()
        assert len(kind.schema.data) < 30_000


def test_definitions_of_logs_that_are_none():
    adapter = MavlinkAdapter("common")
    kind = adapter.type_named("mavlink/ATTITUDE")
    for schema in (
        Schema("mavlink/ATTITUDE", "ros2msg", kind.schema.data),
        Schema("mavlink/ATTITUDE", "mavlink", b"<mavlink/>"),
        Schema("mavlink/ATTITUDE", "mavlink", b"\xff"),
        Schema("mavlink/LAMP_STATE", "mavlink", b""),
    ):
        assert adapter.type_of_schema(schema) is None
    assert adapter.type_of_schema(Schema("mavlink/ATTITUDE", "mavlink", b"")) is kind
    other = kind.schema.data.replace(b'name="roll"', b'name="bank"')
    assert "bank" in {field.path for field in adapter.type_of_schema(Schema(kind.name, "mavlink", other)).fields()}


def test_names_that_differ_by_case_alone_are_told_apart():
    registry = TypeRegistry([MavlinkAdapter(), Ros2Adapter()])
    assert describe_named("Odometry", registry).name == "nav_msgs/msg/Odometry"
    assert describe_named("ODOMETRY", registry).name == "mavlink/ODOMETRY"
    with pytest.raises(ConfigError, match="unknown message type 'odometry'"):
        describe_named("odometry", registry)


def test_a_file_that_is_refused_changes_nothing(tmp_path):
    adapter = MavlinkAdapter()
    with pytest.raises(ConfigError, match="cannot be read"):
        adapter.load([tmp_path / "missing.xml"])
    assert adapter.type_named("mavlink/HEARTBEAT") is not None
