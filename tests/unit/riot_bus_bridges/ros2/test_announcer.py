import pytest

from riot_bus_bridges.ros2.announcer import OtherBridge


def test_a_bridge_is_known_by_its_token():
    other = OtherBridge(42, "3f2a", "riot_bridge_1")
    assert OtherBridge.parse(f"@riot/bridge/ros2/0/{other.token()}") == other


@pytest.mark.parametrize(
    "token", ["", "a", "a/b", "x/3f/name", "-1/3f/name", "1000/3f/name", "\u0661/3f/name", "/3f/name"]
)
def test_what_is_no_token_is_none(token):
    assert OtherBridge.parse(token) is None
