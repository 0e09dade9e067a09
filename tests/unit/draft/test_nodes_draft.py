from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from riot_bus.draft.model import CommandDraft, SystemDraft
from riot_bus.draft.nodes_draft import nodes_draft
from riot_bus.draft.writing import draft_json, draft_toml
from riot_bus.system.system_file import SystemFile
from riot_bus.types.capabilities import Announcement
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError

ODOMETRY, TWIST, SCAN, PATH = (
    "nav_msgs/msg/Odometry", "geometry_msgs/msg/Twist", "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Path",
)  # fmt: skip
LATCHED = "- history: 1\n  depth: 3\n  reliability: 2\n  durability: 1\n"


def node(name: str, zid: str, *, pub=(), sub=(), serve=(), call=()) -> list[Announcement]:
    roles = {"publishes": pub, "subscribes": sub, "serves": serve, "calls": call}
    return [
        Announcement(zid, None, "", name, "", "", "ros2 token"),
        *(
            Announcement(zid, role, f"0{topic}/{kind}/hash", name, topic, kind, "ros2 token")
            for role, topics in roles.items()
            for topic, kind in topics
        ),
    ]


LIDAR = node("/lidar", "a1", pub=[("/scan", SCAN), ("/rosout", "rcl_interfaces/msg/Log")])
ODOM = node("/base/odometry", "b2", pub=[("/odom", ODOMETRY)], sub=[("/cmd_vel", TWIST)])
PLANNER = node(
    "/planner",
    "c3",
    pub=[("/plan", PATH)],
    sub=[("/scan", SCAN), ("/odom", ODOMETRY), ("/goal", "g/msg/G")],
    serve=[("/plan_to", "nav_msgs/srv/GetPlan"), ("/planner/get_parameters", "rcl_interfaces/srv/GetParameters")],
)
CONTROLLER = node("/controller", "d4", pub=[("/cmd_vel", TWIST)], sub=[("/plan", PATH), ("/odom", ODOMETRY)])
DAEMON = node("/_ros2cli_daemon_0_abc", "e5", sub=[("/scan", SCAN)])
SYSTEM = [*LIDAR, *ODOM, *PLANNER, *CONTROLLER, *DAEMON]


def parsed(found: SystemDraft) -> SystemFile:
    text = draft_toml(found, name="ros2", origin="a test\nwith = 'two lines'")
    return SystemFile.model_validate({**tomllib.loads(text), "path": Path("riot.toml").resolve()})


def test_components_topics_and_what_is_external() -> None:
    found = nodes_draft(SYSTEM, offered={f"0/odom/{ODOMETRY}/hash": {"offered_qos_profiles": LATCHED}})
    file = parsed(found)
    assert list(file.components) == ["base_odometry", "controller", "lidar", "planner"]
    assert file.components["planner"].inputs == ("/goal", "/odom", "/scan")
    assert file.components["planner"].outputs == ("/plan",)
    assert [name for name, each in file.components.items() if each.external] == ["lidar"]
    assert (file.components["lidar"].segment, file.components["planner"].segment) == ("outside", "inside")
    assert file.external.topics == ("/goal", "/scan")
    assert set(file.unit) == {"base_odometry", "controller", "planner"}
    text = draft_toml(found, name="ros2", origin="")
    assert "# nav_msgs/msg/Odometry, best effort, transient local, depth 3" in text
    assert "# no publisher was seen" in text
    assert "# Services, which are not tested: serves /plan_to." in text
    assert '"__node:=odometry", "-r", "__ns:=/base"' in text
    assert "rosout" not in text
    assert "daemon" not in text
    assert text.count("# FILL IN: how to start it (one process") == len(file.components)
    assert 'connect/endpoints=[\\"{endpoint}\\"]' in text


def test_a_unit_and_its_upstream() -> None:
    file = parsed(nodes_draft(SYSTEM, unit="planner"))
    assert set(file.unit) == {"planner"}
    assert file.external.topics == ("/goal", "/scan")
    loop = [*ODOM, *CONTROLLER]
    file = parsed(nodes_draft(loop, unit="/controller"))
    assert [name for name, each in file.components.items() if each.external] == ["base_odometry"]
    assert file.external.topics == ("/odom", "/plan")
    assert parsed(nodes_draft(loop)).external.topics == ("/plan",)


def test_the_user_says_what_is_external() -> None:
    file = parsed(nodes_draft(SYSTEM, external=["odometry", "lidar"]))
    assert file.external.topics == ("/goal", "/odom", "/scan")
    with pytest.raises(ConfigError, match="cannot be under test and external"):
        nodes_draft(SYSTEM, unit="planner", external=["/planner"])
    with pytest.raises(ConfigError, match="no node 'plannr'") as caught:
        nodes_draft(SYSTEM, unit="plannr")
    assert "planner" in str(caught.value.hint)
    twins = [*node("/a/cam", "1", pub=[("/x", SCAN)]), *node("/b/cam", "2", pub=[("/y", SCAN)])]
    with pytest.raises(ConfigError, match="several nodes") as caught:
        nodes_draft(twins, unit="cam")
    assert "a_cam, b_cam" in str(caught.value.hint)


def test_nodes_of_one_session_are_one_component() -> None:
    found = nodes_draft([*node("/one", "a", pub=[("/x", SCAN)]), *node("/two", "a", sub=[("/y", TWIST)])])
    (part,) = found.parts
    assert (part.name, part.nodes) == ("one", ("/one", "/two"))
    assert "several nodes: /one, /two" in draft_toml(found, name="ros2", origin="")
    assert not part.external
    twice = nodes_draft([*node("/one", "a", pub=[("/x", SCAN)]), *node("/one", "b", pub=[("/x", SCAN)])])
    assert [each.name for each in twice.parts] == ["one", "one_2"]


def test_nodes_behind_one_bridge_are_components_that_their_launch_file_starts() -> None:
    command = ("/usr/bin/python3", "/opt/ros/bin/ros2", "launch", "robot.launch.py")
    launch = CommandDraft(command, "/home/me", pid=7, only="planner")
    seen = [
        *node("/lidar", "a", pub=[("/scan", SCAN)]),
        *node("/robot1/planner", "a", sub=[("/scan", SCAN)], pub=[("/plan", PATH)]),
        *node("/elsewhere", "a", sub=[("/plan", PATH)]),
    ]
    starts = {"/lidar": CommandDraft(("lidar",), "/", pid=9), "/planner": launch}
    bridge = {"a": CommandDraft(("riot", "bridge", "ros2"), "/", pid=3)}
    found = nodes_draft(seen, unit="planner", external=["lidar"], started=bridge, behind={"a": starts})
    file = parsed(found)
    assert list(file.components) == ["elsewhere", "lidar", "robot1_planner"]
    assert all(each.dds and not each.env for each in file.components.values())
    planner, lidar = file.components["robot1_planner"], file.components["lidar"]
    assert (planner.command, planner.cwd, planner.only) == (launch.command, "/home/me", "planner")
    assert (lidar.command, lidar.only, lidar.segment, lidar.external) == (("lidar",), None, "outside", True)
    assert file.components["elsewhere"].command[:2] == ("ros2", "run")
    assert file.external.topics == ("/scan",)


def test_what_is_one_process_cannot_be_under_test_and_external() -> None:
    both = [*node("/one", "a", pub=[("/x", SCAN)]), *node("/two", "a", sub=[("/y", TWIST)])]
    with pytest.raises(ConfigError, match="cannot be under test and external: /one, /two are one process"):
        nodes_draft(both, unit="two", external=["one"])


def test_bridges_tell_types_that_keys_do_not() -> None:
    seen = [
        Announcement("aaaaaaaa", "publishes", "scan", "", "/scan", SCAN, "bridge token"),
        Announcement("bbbbbbbb", "subscribes", "scan", "", "/scan", SCAN, "bridge token"),
        Announcement(
            "bbbbbbbb", "serves", "dock", "", "/dock", "x/action/Dock", "bridge token", "/dock", "x/action/Dock"
        ),
    ]
    found = nodes_draft(seen)
    file = parsed(found)
    assert file.system.adapters == ("ros2dds",)
    assert file.system.types == {"/scan": SCAN}
    assert list(file.components) == ["bridge_aaaaaa", "bridge_bbbbbb"]
    assert file.external.topics == ("/scan",)
    assert "# Actions, which are not tested: /dock." in draft_toml(found, name="ros2", origin="")


def test_commands_of_processes_that_run_here() -> None:
    command = ("/usr/bin/python3", "planner.py", '--text="{x}\n"')
    found = nodes_draft(SYSTEM, started={"c3": CommandDraft(command, "/home/me/ws", pid=77)})
    planner, other = (parsed(found).components[name] for name in ("planner", "lidar"))
    assert (planner.command, planner.cwd) == (command, "/home/me/ws")
    assert "ZENOH_CONFIG_OVERRIDE" in planner.env
    assert "# As process 77 was started." in draft_toml(found, name="ros2", origin="")
    assert other.command[:4] == ("ros2", "run", "PACKAGE", "EXECUTABLE")
    started = {each["name"]: each["started"] for each in draft_json(found)["components"]}
    assert started["planner"] == {"pid": 77, "command": list(command), "cwd": "/home/me/ws"}
    assert started["lidar"] is None


def test_unknown_types_are_named() -> None:
    found = nodes_draft(SYSTEM, known=lambda name: name != "g/msg/G")
    assert found.unknown_types == ("g/msg/G",)
    assert "#   g/msg/G" in draft_toml(found, name="ros2", origin="")
    assert draft_json(found)["unknown_types"] == ["g/msg/G"]


def test_names_from_the_network_stay_names() -> None:
    evil = 'x"]\n[components.evil]\ncommand = ["rm"]'
    file = parsed(nodes_draft(node(f"/{evil}", "a", pub=[(f"/{evil}", f"a/msg/{evil}")])))
    (component,) = file.components.values()
    assert component.outputs == (f"/{evil}",)


def test_nobody_there() -> None:
    for seen in ([], DAEMON, [Announcement("a", "publishes", "k", "", "", "", "advanced token")]):
        with pytest.raises(EnvironmentFaultError, match="no ROS 2 nodes") as caught:
            nodes_draft(seen, where="tcp/127.0.0.1:7447")
        assert "rmw_zenoh_cpp" in str(caught.value.hint)
