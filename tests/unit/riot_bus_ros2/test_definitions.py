import pytest

from riot_bus_ros2.definitions import (
    DefinitionError,
    Field,
    fields_of,
    interface_of,
    parse_file,
    parse_idl,
    parse_msg,
    parse_recorded,
    references,
)

LINE = "=" * 80


def names(definition):
    return [field.name for field in fields_of(definition)]


def test_fields_with_their_bounds():
    text = "string<=5 a\nstring<=6[<=3] b\nint8[4] c\nOther[<=2] d\nwstring<=7 e\nwstring[] f\nfloat64[] g\n"
    found = parse_msg(text, "pkg/msg/Name")
    assert list(fields_of(found["pkg/msg/Name"])) == [
        Field("a", "string", is_message=False, most_bytes=5),
        Field("b", "string", is_message=False, is_array=True, most=3, most_bytes=6),
        Field("c", "int8", is_message=False, is_array=True, length=4),
        Field("d", "pkg/msg/Other", is_message=True, is_array=True, most=2),
        Field("e", "wstring", is_message=False, most_bytes=7),
        Field("f", "wstring", is_message=False, is_array=True),
        Field("g", "float64", is_message=False, is_array=True),
    ]


def test_a_service():
    text = "# asks\r\nint64 a\nColour tint\n---\nint64 sum\nother_msgs/Thing thing\n"
    found = parse_file(text, "pkg/srv/Add", ".srv")
    assert set(found) == {"pkg/srv/Add", "pkg/srv/Add_Request", "pkg/srv/Add_Response", "pkg/srv/Add_Event"}
    assert list(references(found["pkg/srv/Add_Request"])) == ["pkg/msg/Colour"]
    assert list(references(found["pkg/srv/Add_Response"])) == ["other_msgs/msg/Thing"]
    assert names(found["pkg/srv/Add"]) == ["request_message", "response_message", "event_message"]
    assert [field.most for field in fields_of(found["pkg/srv/Add_Event"])] == [0, 1, 1]


def test_an_empty_service():
    found = parse_file("---\n", "pkg/srv/Empty", ".srv")
    assert found["pkg/srv/Empty_Request"] == found["pkg/srv/Empty_Response"] == ([], [])


def test_an_action():
    found = parse_file("int32 order\n---\nint32[] all\n---\nint32[] some\n", "pkg/action/Count", ".action")
    parts = {"Goal", "Result", "Feedback", "FeedbackMessage", "SendGoal", "GetResult"}
    parts |= {f"{each}_{part}" for each in ("SendGoal", "GetResult") for part in ("Request", "Response", "Event")}
    assert set(found) == {"pkg/action/Count", *(f"pkg/action/Count_{part}" for part in parts)}
    assert names(found["pkg/action/Count_FeedbackMessage"]) == ["goal_id", "feedback"]
    assert {interface_of(name) for name in found} == {"pkg/action/Count"}


def test_names_that_are_no_parts():
    for name in ("pkg/msg/A_Request", "pkg/srv/Response", "json"):
        assert interface_of(name) == name


@pytest.mark.parametrize(
    ("text", "name", "suffix"),
    [
        ("int8 a\n", "pkg/srv/A", ".srv"),
        ("int8 a\n---\n---\n", "pkg/srv/A", ".srv"),
        ("int8 a\n---\n", "pkg/action/A", ".action"),
        ("int8 a\n---\nint8 b\n", "pkg/msg/A", ".msg"),
        ("int8 9a\n---\n", "pkg/srv/A", ".srv"),
        ("module pkg { module msg { struct B { long a; }; }; };", "pkg/msg/A", ".idl"),
        ("int8 class\nint8 class_\n" + "x" * (1 << 20), "pkg/msg/A", ".msg"),
    ],
)
def test_files_that_define_something_else(text, name, suffix):
    with pytest.raises(DefinitionError):
        parse_file(text, name, suffix)


@pytest.mark.parametrize("name", ["p/q/r/s/t", "p/q", "p(/srv/A_Request", "p/srv/(_Request", "/srv/"])
def test_schemas_of_odd_names(name):
    try:
        found = parse_recorded("int32 a\n", name)
    except DefinitionError:
        return
    assert all(isinstance(each, str) for each in found)


def test_a_service_in_idl():
    text = """#include "other_msgs/msg/Thing.idl"
    module pkg { module srv {
        @verbatim (language="comment", text= "((what (is) this))" "\\n" "<<")
        struct Add_Request { int64 a; @unit (value="m") double b; /* ((x)) */ };
        struct Add_Response { sequence<other_msgs::msg::Thing, 3> things; wstring<9> text; };
    }; };
    """
    found = parse_file(text, "pkg/srv/Add", ".idl")
    assert names(found["pkg/srv/Add_Request"]) == ["a", "b"]
    assert list(fields_of(found["pkg/srv/Add_Response"])) == [
        Field("things", "other_msgs/msg/Thing", is_message=True, is_array=True, most=3),
        Field("text", "wstring", is_message=False, most_bytes=9),
    ]
    assert "pkg/srv/Add_Event" in found


@pytest.mark.parametrize("value", ["1 << 99999999999", "((((((((1))))))))"])
def test_idl_that_would_take_for_ever(value):
    with pytest.raises(DefinitionError, match="not supported"):
        parse_idl(f"module pkg {{ const long A = {value}; }};")


@pytest.mark.parametrize("name", ["1pkg/Inner", "pkg/2Inner", "//"])
def test_names_that_no_type_can_have(name):
    with pytest.raises(DefinitionError):
        parse_msg(f"int8 a\n{LINE}\nMSG: {name}\nint8 b\n", "pkg/msg/Outer")


def test_recorded_events_of_a_service_have_the_service_text():
    text = f"int64 a\n---\nThing sum\n{LINE}\nMSG: pkg/Thing\nint8 x\n"
    found = parse_recorded(text, "pkg/srv/Add_Event")
    assert names(found["pkg/srv/Add_Event"]) == ["info", "request", "response"]
    assert names(found["pkg/srv/Add_Response"]) == ["sum"]
    assert names(found["pkg/msg/Thing"]) == ["x"]


def test_recorded_parts_have_their_own_names():
    text = f"pkg/Count_Goal goal\nCount other\n{LINE}\nMSG: pkg/Count_Goal\nint8 x\n{LINE}\nMSG: pkg/Count\nint8 y\n"
    found = parse_recorded(text, "pkg/action/Count_SendGoal_Request")
    assert set(found) == {"pkg/action/Count_SendGoal_Request", "pkg/action/Count_Goal", "pkg/msg/Count"}
    assert list(references(found["pkg/action/Count_SendGoal_Request"])) == ["pkg/action/Count_Goal", "pkg/msg/Count"]
