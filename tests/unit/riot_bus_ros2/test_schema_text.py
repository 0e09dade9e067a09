import pytest

from riot_bus_ros2.common_services import ACTIONS, SERVICES
from riot_bus_ros2.definitions import parse_file, parse_idl, parse_msg, parse_recorded
from riot_bus_ros2.schema_text import schema_text
from riot_bus_ros2.store import TypeStore

STORE = TypeStore()


@pytest.mark.parametrize("name", [name for name in STORE.names() if "/msg/" in name])
def test_text_parses_to_what_it_was_written_from(name):
    closure = STORE.closure(name)
    again = parse_msg(schema_text(name, closure), name)
    assert list(again) == list(closure)
    assert {each: [list(map(tuple, part)) for part in again[each]] for each in again} == {
        each: [list(map(tuple, part)) for part in without_placeholder(closure[each])] for each in closure
    }


def without_placeholder(definition):
    constants, fields = definition
    return constants, [field for field in fields if field[0] != "structure_needs_at_least_one_member"]


@pytest.mark.parametrize("interface", [*SERVICES, *ACTIONS])
def test_parts_of_services_and_actions_keep_their_hashes(interface):
    texts, suffix = (SERVICES, ".srv") if interface in SERVICES else (ACTIONS, ".action")
    for name in parse_file(texts[interface], interface, suffix):
        if name == interface or name.endswith(("_SendGoal", "_GetResult")):
            continue  # no messages
        again = TypeStore(parse_recorded(STORE.schema(name).data.decode(), name))
        assert again.type_hash(name) == STORE.type_hash(name)


def test_constants():
    text = 'bool A=true\nstring B="it\'s # not"\nstring C=\'say "x"\'\nstring D=plain text\n'
    text += "float32 E=-1.5\nuint8 F=200\n"
    definitions = parse_msg(text, "pkg/msg/Name")
    assert parse_msg(schema_text("pkg/msg/Name", definitions), "pkg/msg/Name") == definitions


def test_constants_of_several_lines_are_left_out():
    text = 'module a { module msg { module X_Constants { const string K = "\nint8 y\n"; const int8 L = 3; };'
    definitions = parse_idl(text + " struct X { double x; }; }; };")
    assert [each[0] for each in definitions["a/msg/X"][0]] == ["K", "L"]
    assert schema_text("a/msg/X", definitions) == "int8 L=3\nfloat64 x\n"
