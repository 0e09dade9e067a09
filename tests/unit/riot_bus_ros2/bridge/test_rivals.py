import pytest

from riot_bus_ros2.bridge.rivals import Rival


def test_a_bridge_is_known_by_its_token():
    rival = Rival(42, "3f2a", "riot_bridge_1")
    assert Rival.parse(f"@riot/bridge/ros2/0/{rival.token()}") == rival


@pytest.mark.parametrize(
    "token", ["", "a", "a/b", "x/3f/name", "-1/3f/name", "1000/3f/name", "\u0661/3f/name", "/3f/name"]
)
def test_what_is_no_token_is_none(token):
    assert Rival.parse(token) is None
