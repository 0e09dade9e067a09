from __future__ import annotations

import struct

import pytest

from riot_bus.types.capabilities import Stamp
from riot_bus.types.registry import TypeRegistry
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.attachment import Attachment, build_attachment
from riot_bus_ros2.qos import RosQos, parse_offered
from riot_bus_ros2.stamping import definition_of, details_of, stamp_of

TYPE = "std_msgs::msg::dds_::String_"
KEY = f"0/robot/chatter/{TYPE}/RIHS01_df"


def profile_of(text: str) -> str:
    return RosQos.parse(text).profile()


def token(qos: str, *, kind: str = "MP", topic: str = "%robot%chatter", domain: int = 0) -> str:
    return f"@ros2_lv/{domain}/aa/0/1/{kind}/%/%/talker/{topic}/{TYPE}/RIHS01_df/{qos}"


@pytest.mark.parametrize("version", [1, 2])
def test_attachments_of_both_versions_are_read(version) -> None:  # type: ignore[no-untyped-def]
    gid = bytes(range(16))
    data = build_attachment(Attachment(7, 10**18, gid, version))
    assert stamp_of(data) == Stamp(7, 10**18, gid)


@pytest.mark.parametrize("data", [b"", bytes(33), bytes(77), bytes(5), struct.pack("<qqB16s", 1, 2, 15, bytes(16))])
def test_other_bytes_are_none(data: bytes) -> None:
    assert stamp_of(data) is None


def test_a_profile_is_that_of_the_token() -> None:
    text = profile_of("2:1:2,7:1,5:,:2,3,4")
    assert text.startswith("- history: 2\n  depth: 7\n  reliability: 2\n  durability: 1\n")
    assert "  deadline:\n    sec: 1\n    nsec: 5\n  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n" in text
    assert "  liveliness: 2\n  liveliness_lease_duration:\n    sec: 3\n    nsec: 4\n" in text
    usual = parse_offered(profile_of("::,:,:,:,,"))
    assert (usual.reliable, usual.latched, usual.depth) == (True, False, 42)
    for odd in ("", "x:y:z", ":::::::::", "9" * 50, "-1:,"):
        assert parse_offered(profile_of(odd)).depth == 42


def test_all_publishers_of_a_topic_are_told() -> None:
    tokens = [
        token("::,5:,:,:,,"),
        token("2:1:,1:,:,:,,"),
        token("::,9:,:,:,,", kind="MS"),
        token("::,9:,:,:,,", topic="%other"),
        token("::,9:,:,:,,", domain=1),
        "@ros2_lv/0/aa/0/0/NN/%/%/talker",
        "nonsense",
    ]
    text = details_of(KEY, tokens)["offered_qos_profiles"]
    assert text.count("- history:") == 2
    assert "depth: 5" in text
    assert "depth: 1\n" in text
    assert "depth: 9" not in text
    assert details_of(KEY, []) == details_of("a/b", tokens) == {}


def test_a_type_that_is_unknown_has_a_name_at_least() -> None:
    found = definition_of("0/x/my_msgs::msg::dds_::Odd_/TypeHashNotSupported")
    assert found is not None
    assert (found[0].name, found[0].data, found[1]) == ("my_msgs/msg/Odd", b"", "cdr")
    assert definition_of("a/b") is None


def test_the_registry_finds_who_stamps() -> None:
    registry = TypeRegistry([Ros2Adapter()])
    adapter = registry.metadata_adapter(KEY)
    assert adapter is registry.metadata_adapters()[0]
    assert registry.metadata_adapter("a/b") is None
    assert adapter is not None
    assert adapter.stamp(b"") is None
    assert adapter.details(KEY, [token("::,5:,:,:,,")])
    assert adapter.definition(KEY) is not None
