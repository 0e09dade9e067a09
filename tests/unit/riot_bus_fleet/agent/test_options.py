from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_fleet.agent.names import agent_token, check_robot, controller_key, default_robot, progress_key
from riot_bus_fleet.agent.options import AgentOptions, ControllerOptions, _policy


def options(tmp_path: Path, **more: Any) -> AgentOptions:
    return AgentOptions(**{"robot": "r7", "folder": tmp_path, "endpoint": "tcp/127.0.0.1:7447", **more})


def test_an_agent_of_one_router(tmp_path: Path) -> None:
    found = options(tmp_path, config={"a": 1})
    found.check()
    assert (found.commanded_at, found.commanded_with) == ("tcp/127.0.0.1:7447", {"a": 1})


def test_an_agent_of_two_routers(tmp_path: Path) -> None:
    found = options(tmp_path, fleet="tls/fleet:7447", config={"a": 1}, fleet_config={"b": 2})
    found.check()
    assert (found.commanded_at, found.commanded_with) == ("tls/fleet:7447", {"b": 2})
    assert options(tmp_path, fleet="tcp/x:1", config={"a": 1}).commanded_with == {}


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"robot": "r/7"}, "is not a name of a robot"),
        ({"robot": "*"}, "is not a name of a robot"),
        ({"robot": ""}, "is not a name of a robot"),
        ({"endpoint": "nonsense"}, "is not an endpoint"),
        ({"fleet": "tcp/127.0.0.1:0"}, "no client can connect"),
        ({"folder": Path("/nowhere")}, "there is no folder"),
        ({"allow": ["fly"]}, "'fly' cannot be allowed"),
    ],
)
def test_what_cannot_work(tmp_path: Path, more: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        options(tmp_path, **more).check()


def test_policies_of_a_controller() -> None:
    assert ControllerOptions().policy("stop") == {"on_lost_controller": "stop", "grace": 10.0}
    assert ControllerOptions(on_lost_controller="pause", grace=1.0).policy("stop")["on_lost_controller"] == "pause"
    assert ControllerOptions(detach=True).policy("stop")["on_lost_controller"] == "continue"
    with pytest.raises(ConfigError, match="--detach and --on-lost-controller stop exclude each other"):
        ControllerOptions(detach=True, on_lost_controller="stop").policy("stop")
    with pytest.raises(ConfigError, match="--on-lost-controller: unknown policy 'fly'"):
        _policy("fly", "--on-lost-controller")


def test_keys() -> None:
    assert check_robot(default_robot())
    assert agent_token("r7", "ab") == "@riot/r7/agent/ab"
    assert controller_key("r7", "cd") == "@riot/r7/agent/controller/cd"
    assert progress_key("r7") == "@riot/r7/agent/progress"
