from __future__ import annotations

from riot_bus.record.options import CaptureOptions
from riot_bus.record.selection import RecordingSelection
from riot_bus.record.trigger import Trigger
from riot_bus.types.registry import TypeRegistry, load_adapters

ODOM = "0/odom/nav_msgs::msg::dds_::Odometry_/RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"


def selection(**more: object) -> tuple[RecordingSelection, list[str]]:
    told: list[str] = []
    registry = TypeRegistry(load_adapters())
    options = CaptureOptions(**more)  # type: ignore[arg-type]
    return RecordingSelection(
        options, registry=registry, trigger=Trigger([], registry=registry), warn=told.append
    ), told


def test_what_was_named_and_never_came_is_known() -> None:
    chosen, _ = selection(keys=["robot/*/odom", "/odom", "x", "**", "y"], exclude=["x"])
    assert chosen.silent() == ["robot/*/odom", "/odom", "x", "y"]
    for key in ("robot/1/odom", ODOM, "x"):
        chosen.rules(key)
    assert chosen.silent() == ["y"]
    assert selection(keys=[f"k{n}" for n in range(101)])[0].silent() == []


def test_what_a_bag_cannot_hold_is_said_once() -> None:
    chosen, told = selection(keys=["**"], bag=True)
    assert chosen.rules(ODOM) is not None
    assert told == []
    for _ in range(2):
        assert chosen.rules("robot/odom") is None
    assert told == ["robot/odom is not a topic of ROS 2 and is not recorded, since a bag cannot hold it"]
    for number in range(1000):
        chosen.rules(f"robot/{number}")
    assert len(told) <= 20
