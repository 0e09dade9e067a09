import subprocess
import sys

import numpy as np
import pytest

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.definitions import DefinitionError, normal_name, parse_idl, parse_msg
from riot_bus_ros2.store import TypeStore

STORE = TypeStore()
POINT_IDL = """module my_pkg {
  module msg {
    struct Point {
      double x;
      sequence<float> values;
    };
  };
};
"""


def test_importing_does_not_import_rosbags():
    code = "import sys, riot_bus_ros2.adapter as a; a.Ros2Adapter(); print('rosbags' in sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.split() == ["False"]


def test_normal_names():
    assert normal_name("nav_msgs/Odometry") == "nav_msgs/msg/Odometry"
    assert normal_name("nav_msgs/msg/Odometry") == "nav_msgs/msg/Odometry"
    assert normal_name("json") == "json"


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        # as in the distributions; Char is one that rosbags 0.11 gets wrong without the work-around
        ("std_msgs/msg/String", "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
        ("std_msgs/msg/Char", "RIHS01_3ad2d04dd29ba19d04b16659afa3ccaedd691914b02a64e82e252f2fa6a586a9"),
    ],
)
def test_type_hashes(name, expected):
    assert STORE.type_hash(name) == expected


def test_types_that_only_a_newer_distribution_has():
    assert STORE.definition("nav_msgs/msg/Trajectory") is not None
    assert STORE.definition("no_such/msg/Type") is None
    with pytest.raises(KeyError):
        STORE.fields("no_such/msg/Type")


def test_schema_has_all_dependencies_and_parses_again():
    schema = STORE.schema("nav_msgs/msg/Odometry")
    assert (schema.name, schema.encoding) == ("nav_msgs/msg/Odometry", "ros2msg")
    text = schema.data.decode()
    assert "=" * 80 + "\nMSG: geometry_msgs/Quaternion\n" in text
    again = parse_msg(text, schema.name)
    assert set(again) == set(STORE.closure(schema.name))
    assert TypeStore(again).type_hash(schema.name) == STORE.type_hash(schema.name)


def test_fields():
    fields = {field.name: field for field in STORE.fields("geometry_msgs/msg/PoseWithCovariance")}
    assert fields["pose"].is_message
    assert (fields["covariance"].content, fields["covariance"].length) == ("float64", 36)


def test_own_definitions_override_without_touching_other_stores():
    own = TypeStore(parse_msg("int64 data\n", "std_msgs/msg/String"))
    assert own.fields("std_msgs/msg/String")[0].content == "int64"
    assert STORE.fields("std_msgs/msg/String")[0].content == "string"
    assert own.type_hash("std_msgs/msg/String") != STORE.type_hash("std_msgs/msg/String")
    payload = b"\0\1\0\0" + (7).to_bytes(8, "little")
    assert own.decode(payload, "std_msgs/msg/String").data == 7


def test_a_definition_over_a_replaced_one_uses_the_replacement():
    own = TypeStore(parse_msg("int8 sec\n", "builtin_interfaces/msg/Time"))
    payload = b"\0\1\0\0" + b"\x05\0\0\0" + b"\x02\0\0\0a\0"
    assert own.decode(payload, "std_msgs/msg/Header").stamp.sec == 5


@pytest.mark.parametrize("text", ["float64", "strange", "int32 9x", "int32 a\n---\nint32 b\n"])
def test_text_that_does_not_parse(text):
    with pytest.raises(DefinitionError):
        parse_msg(text, "my_pkg/msg/Bad")


def test_wstring_is_kept_as_a_base_type():
    own = TypeStore(parse_msg("wstring<=5 a\nwstring b\nwstring[] c\n", "my_pkg/msg/Wide"))
    assert [field.content for field in own.fields("my_pkg/msg/Wide")] == ["wstring"] * 3
    assert own.schema("my_pkg/msg/Wide").data == b"wstring<=5 a\nwstring b\nwstring[] c\n"


def test_idl():
    text = "=" * 80 + "\nIDL: my_pkg/msg/Point\n" + POINT_IDL
    for each in (text, POINT_IDL):
        fields = TypeStore(parse_idl(each)).fields("my_pkg/msg/Point")
        assert [(field.name, field.content, field.is_array) for field in fields] == [
            ("x", "float64", False),
            ("values", "float32", True),
        ]
    with pytest.raises(DefinitionError):
        parse_idl("module {")


def test_ament_prefix_path(tmp_path, monkeypatch):
    folder = tmp_path / "share" / "my_pkg" / "msg"
    folder.mkdir(parents=True)
    (folder / "Outer.msg").write_text("std_msgs/Header header\nInner inner\n")
    (folder / "Inner.msg").write_text("float32 x\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    own = TypeStore()
    assert set(own.closure("my_pkg/msg/Outer")) == {
        "my_pkg/msg/Outer",
        "my_pkg/msg/Inner",
        "std_msgs/msg/Header",
        "builtin_interfaces/msg/Time",
    }
    assert own.definition("my_pkg/msg/Absent") is None
    assert own.definition("my_pkg/msg/../../Outer") is None


def test_decoding_lets_trailing_bytes_pass():
    message = STORE.decode(b"\0\1\0\0\x03\0\0\0ab\0" + b"x" * 8, "std_msgs/msg/String")
    assert message.data == "ab"


def test_errors_of_rosbags_become_payload_errors():
    with pytest.raises(PayloadError, match="does not decode"):
        STORE.decode(b"\0\1\0\0\xff\xff\xff\xff", "std_msgs/msg/String")


def test_decoded_arrays_are_numpy_views():
    name = "std_msgs/msg/UInt8MultiArray"
    payload = b"\0\1\0\0" + b"\0" * 8 + b"\x02\0\0\0\x01\x02"
    assert np.array_equal(STORE.decode(payload, name).data, [1, 2])
