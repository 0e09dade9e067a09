import os

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_ros2.files import load_files
from riot_bus_ros2.store import TypeStore

IDL = "module pkg {{ module {kind} {{ {structs} }}; }};\n"


def write(root, name, text):
    file = root / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    return file


def test_all_kinds_of_files(tmp_path):
    write(tmp_path, "pkg/msg/Point.msg", "float64 x\n")
    write(tmp_path, "pkg/srv/Ask.srv", "Point a\n---\nbool b\n")
    write(tmp_path, "pkg/action/Go.action", "Point to\n---\n---\nfloat32 left\n")
    write(tmp_path, "pkg/msg/Wide.idl", IDL.format(kind="msg", structs="struct Wide { wstring text; };"))
    store = TypeStore()
    load_files([tmp_path], store)
    assert [field.content for field in store.fields("pkg/srv/Ask_Request")] == ["pkg/msg/Point"]
    assert [field.name for field in store.fields("pkg/action/Go_FeedbackMessage")] == ["goal_id", "feedback"]
    assert store.fields("pkg/msg/Wide")[0].content == "wstring"
    assert store.type_hash("pkg/action/Go_SendGoal").startswith("RIHS01_")


def test_an_idl_beside_its_source_is_not_read(tmp_path):
    write(tmp_path, "pkg/msg/Point.msg", "float64 x\n")
    write(tmp_path, "pkg/msg/Point.idl", "not IDL")
    load_files([tmp_path], TypeStore())


def test_a_bad_line_of_a_service(tmp_path):
    file = write(tmp_path, "pkg/srv/Ask.srv", "int8 a\n---\nint8 9b\n")
    with pytest.raises(ConfigError, match="cannot parse 'int8 9b'") as caught:
        load_files([file], TypeStore())
    assert caught.value.where == f"{file}:3"


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("pkg/srv/Ask.srv", "int8 a\n", "1 parts instead of 2"),
        ("pkg/msg/Bad.idl", "module pkg {", "cannot parse the IDL"),
        ("pkg/msg/Bad.idl", IDL.format(kind="msg", structs="struct Good { long a; };"), "does not define pkg/msg/Bad"),
        ("pkg/srv/Odd.msg", "int8 a\n", "not a file in a layout"),
        ("pkg/srv/Ask.srv", "int8 a\n---\nOther b\n", "unknown type 'pkg/msg/Other'"),
    ],
)
def test_files_that_are_refused(tmp_path, name, text, problem):
    file = write(tmp_path, name, text)
    with pytest.raises(ConfigError, match=problem) as caught:
        load_files([file], TypeStore())
    assert str(file) in caught.value.where


def test_a_file_that_is_too_large(tmp_path):
    file = write(tmp_path, "pkg/msg/Large.msg", "")
    os.truncate(file, 1 << 30)
    with pytest.raises(ConfigError, match="more than 1048576 bytes"):
        load_files([file], TypeStore())
