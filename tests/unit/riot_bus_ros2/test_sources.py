import pytest

from riot_bus_ros2.definitions import parse_msg
from riot_bus_ros2.sources import DISTROS, HUMBLE, OLDER, from_ament, from_common_services, from_distribution
from riot_bus_ros2.store import TypeStore

BOOL = "std_msgs/msg/Bool"


def install(root, name, text):
    package, kind, file = name.split("/")
    folder = root / "share" / package / kind
    folder.mkdir(parents=True, exist_ok=True)
    (folder / file).write_text(text)


def kind_of(store):
    return store.fields(BOOL)[0].content


def test_the_order_of_sources(tmp_path, monkeypatch):
    """A log, AMENT_PREFIX_PATH, files, distributions, nodes."""
    live = TypeStore()
    told = parse_msg("uint8 data\n", BOOL)
    live.learn(BOOL, told)
    live.learn("pkg/msg/New", parse_msg("int8 a\n", "pkg/msg/New"))
    assert kind_of(live) == "bool"
    assert kind_of(live.matching(BOOL, TypeStore(told).type_hash(BOOL))) == "uint8"
    assert live.definition("pkg/msg/New") is None
    assert live.told("pkg/msg/New").fields("pkg/msg/New")[0].content == "int8"
    assert live.told("pkg/msg/Newer") is None
    live.register(parse_msg("int16 data\n", BOOL))
    assert kind_of(live) == "int16"
    install(tmp_path, "std_msgs/msg/Bool.msg", "int32 data\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    ament = TypeStore()
    ament.register(parse_msg("int16 data\n", BOOL))
    assert kind_of(ament) == "int32"
    assert kind_of(TypeStore(parse_msg("int64 data\n", BOOL))) == "int64"


def test_services_and_idl_of_an_installation(tmp_path, monkeypatch):
    install(tmp_path, "pkg/srv/Ask.srv", "int8 a\n---\nint8 b\n")
    install(tmp_path, "pkg/action/Go.action", "int8 a\n---\n---\n")
    install(tmp_path, "pkg/msg/Only.idl", "module pkg { module msg { struct Only { long a; }; }; };")
    install(tmp_path, "pkg/msg/Broken.msg", "strange\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    for name in ("pkg/srv/Ask_Request", "pkg/srv/Ask", "pkg/action/Go_FeedbackMessage", "pkg/msg/Only"):
        assert from_ament(name) is not None
    for name in ("pkg/msg/Broken", "pkg/msg/Absent", "pkg/msg/../Only", "../pkg/msg/Only", "json", "a/b/c/d", ""):
        assert from_ament(name) is None


def test_without_an_installation(monkeypatch):
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    assert from_ament(BOOL) is None


@pytest.mark.parametrize("distro", [*DISTROS, *OLDER])
def test_distributions(distro):
    assert from_distribution(distro)(BOOL) is not None
    assert from_distribution(distro)("std_msgs/msg/Absent") is None


def test_common_services():
    assert from_common_services("rcl_interfaces/srv/GetParameters_Request") is not None
    assert from_common_services("tf2_msgs/action/LookupTransform_Goal") is not None
    assert from_common_services("rcl_interfaces/srv/Absent_Request") is None


def differing():
    """A type that Humble defines otherwise than the newest distribution."""
    new, old = TypeStore(sources=(from_distribution(DISTROS[0]),)), TypeStore(sources=(from_distribution(HUMBLE),))
    for name in new.names():
        if old.definition(name) is not None and old.type_hash(name) != new.type_hash(name):
            return name, old.type_hash(name)
    pytest.fail("the distributions are the same")


def test_a_definition_with_the_wanted_hash_is_found_in_another_source():
    name, wanted = differing()
    store = TypeStore()
    assert store.matching(name, store.type_hash(name)) is store
    found = store.matching(name, wanted)
    assert found is not None
    assert found is not store
    assert found.type_hash(name) == wanted
    assert store.matching(name, "RIHS01_" + "0" * 64) is None
    assert store.matching("pkg/msg/Absent", wanted) is None
