import json
import sys

import pytest

from riot_bus_bridges.rclpy_node.kinds import UnknownTypeError, message_type, service_type, type_hash


@pytest.fixture
def package(tmp_path, monkeypatch):
    """What rosidl installs for a package of messages, as far as it matters here."""
    folder = tmp_path / "bridge_test_msgs"
    for kind, text in {
        "msg": "class Thing: pass\n",
        "srv": "class Ask:\n    class Request: pass\n",
        "action": "class Go:\n    class Impl:\n        class SendGoalService:\n            class Request: pass\n"
        "        class FeedbackMessage: pass\n",
    }.items():
        (folder / kind).mkdir(parents=True)
        (folder / kind / "__init__.py").write_text(text)
    (folder / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    yield
    for name in [name for name in sys.modules if name.startswith("bridge_test_msgs")]:
        del sys.modules[name]


def test_types_are_found_by_name(package):
    assert message_type("bridge_test_msgs/msg/Thing").__name__ == "Thing"
    assert service_type("bridge_test_msgs/srv/Ask").__name__ == "Ask"
    assert service_type("bridge_test_msgs/action/Go_SendGoal").__name__ == "SendGoalService"
    assert message_type("bridge_test_msgs/action/Go_FeedbackMessage").__name__ == "FeedbackMessage"


@pytest.mark.parametrize(
    "name",
    [
        "bridge_test_msgs/msg/Other",
        "bridge_test_msgs/action/Go",
        "bridge_test_msgs/action/Went_SendGoal",
        "no_such_msgs/msg/Thing",
        "bridge_test_msgs/Thing",
        "bridge_test_msgs/msg/Thing.__init__",
        "../msg/Thing",
        "os.path/msg/Thing",
        "",
    ],
)
def test_what_is_not_there_is_said_so(package, name):
    with pytest.raises(UnknownTypeError, match=r"is not installed|is no"):
        message_type(name)


def test_a_message_is_no_service(package):
    with pytest.raises(UnknownTypeError, match="is not a service"):
        service_type("bridge_test_msgs/msg/Thing")


def test_hashes_are_those_that_are_installed(tmp_path, monkeypatch):
    hashes = {"hashed_msgs/srv/Ask": "RIHS01_aa", "hashed_msgs/srv/Ask_Request": "RIHS01_bb"}
    entries = [{"type_name": name, "hash_string": value} for name, value in hashes.items()]
    file = tmp_path / "share/hashed_msgs/srv/Ask.json"
    file.parent.mkdir(parents=True)
    file.write_text(json.dumps({"type_hashes": entries}))
    action = tmp_path / "share/hashed_msgs/action/Go.json"
    action.parent.mkdir(parents=True)
    action.write_text(
        json.dumps({"type_hashes": [{"type_name": "hashed_msgs/action/Go_SendGoal", "hash_string": "RIHS01_cc"}]})
    )
    (tmp_path / "share/hashed_msgs/srv/Broken.json").write_text("{")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    type_hash.cache_clear()
    assert type_hash("hashed_msgs/srv/Ask") == "RIHS01_aa"
    assert type_hash("hashed_msgs/action/Go_SendGoal") == "RIHS01_cc"
    assert type_hash("hashed_msgs/srv/Broken") == ""
    assert type_hash("hashed_msgs/srv/../../../Ask") == ""
    assert type_hash("humble_msgs/srv/Ask") == ""
    type_hash.cache_clear()
