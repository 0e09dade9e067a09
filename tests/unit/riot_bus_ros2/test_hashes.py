import pytest

from riot_bus_ros2.common_services import ACTIONS, SERVICES
from riot_bus_ros2.definitions import parse_msg
from riot_bus_ros2.hashes import type_hash
from riot_bus_ros2.store import TypeStore

STORE = TypeStore()


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        # as ROS 2 Kilted's own definitions say
        ("std_msgs/msg/String", "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
        ("std_msgs/msg/Char", "3ad2d04dd29ba19d04b16659afa3ccaedd691914b02a64e82e252f2fa6a586a9"),
        ("example_interfaces/srv/AddTwoInts", "e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"),
    ],
)
def test_known_hashes(name, expected):
    assert STORE.type_hash(name) == f"RIHS01_{expected}"


def test_all_known_services_and_actions_have_hashes():
    hashes = {STORE.type_hash(name) for name in (*SERVICES, *ACTIONS)}
    # two packages have the same SetBool and Trigger, but their names count
    assert len(hashes) == len(SERVICES) + len(ACTIONS)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("string a", "string<=5 a"),
        ("string<=5 a", "string<=6 a"),
        ("wstring a", "string a"),
        ("wstring<=5 a", "wstring a"),
        ("int8[] a", "int8[3] a"),
        ("int8[<=3] a", "int8[3] a"),
        ("int8 a", "uint8 a"),
        ("int8 a", "int8 b"),
    ],
)
def test_what_makes_a_difference(one, other):
    hashes = [type_hash("pkg/msg/A", parse_msg(text, "pkg/msg/A")) for text in (one, other)]
    assert hashes[0] != hashes[1]


def test_what_makes_none():
    hashes = {
        type_hash("pkg/msg/A", parse_msg(text, "pkg/msg/A"))
        for text in ("char a\n", "uint8 a\n", "# comment\nuint8 X=3\nuint8 a 5\n")
    }
    assert len(hashes) == 1
    empty = type_hash("pkg/msg/A", {"pkg/msg/A": ([], [])})
    assert empty == type_hash("pkg/msg/A", parse_msg("uint8 structure_needs_at_least_one_member\n", "pkg/msg/A"))


def test_unknown_base_types_have_none():
    with pytest.raises(KeyError):
        type_hash("pkg/msg/A", {"pkg/msg/A": ([], [("a", (1, ("fixed", 0)))])})
