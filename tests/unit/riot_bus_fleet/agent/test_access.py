from __future__ import annotations

import json
import tomllib

import pytest
from typer.testing import CliRunner

from riot_bus.cli.main import make_app
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_fleet.agent.access import ACTIONS, ROLES, access_rules, may, parse_subject
from riot_bus_fleet.agent.names import agent_token, controller_key, progress_key

CHANGING = ("play", "record", "pause", "resume", "seek", "rate", "stop")


@pytest.mark.parametrize("command", CHANGING)
def test_a_viewer_cannot_command_and_nobody_but_an_agent_can_answer(command: str) -> None:
    key = f"@riot/r7/agent/{command}"
    assert [role for role in ROLES if may(role, "ask", key)] == ["controller"]
    assert [role for role in ROLES if may(role, "answer", key)] == ["agent"]
    assert not any(may(role, action, key) for role in ROLES for action in ("put", "receive"))  # type: ignore[arg-type]
    assert [role for role in ROLES if may(role, "announce", key)] == ["agent"]


def test_each_role_has_what_it_needs() -> None:
    assert [role for role in ROLES if may(role, "put", progress_key("r7"))] == ["agent"]
    assert [role for role in ROLES if may(role, "receive", progress_key("r7"))] == ["controller", "viewer"]
    assert [role for role in ROLES if may(role, "announce", agent_token("r7", "ab"))] == ["agent"]
    assert [role for role in ROLES if may(role, "ask", "@riot/r7/agent/status")] == ["controller", "viewer"]
    assert [role for role in ROLES if may(role, "answer", controller_key("r7", "ab"))] == ["agent", "controller"]
    assert [role for role in ROLES if may(role, "ask", controller_key("r7", "ab"))] == ["agent"]


def test_rules_of_one_robot_are_about_no_other() -> None:
    assert may("controller", "ask", "@riot/r7/agent/stop", robot="r7")
    assert not may("controller", "ask", "@riot/r8/agent/stop", robot="r7")


def test_all_is_denied_that_no_rule_allows() -> None:
    rules = access_rules([("viewer", "v"), ("viewer", "w"), ("agent", "r")], certificates=True)
    assert (rules["enabled"], rules["default_permission"]) == (True, "deny")
    assert {each["permission"] for each in rules["rules"]} == {"allow"}
    assert {"id": "viewer", "cert_common_names": ["v", "w"]} in rules["subjects"]
    assert {name for each in rules["rules"] for name in each["messages"]} >= {
        message for _, message in ACTIONS.values()
    }


def test_what_is_printed_is_toml_and_json() -> None:
    words = ["agent", "acl", "agent=robot", "controller=alice", "viewer", "--robot=r7", "--segment=hub"]
    done = CliRunner().invoke(make_app("agent"), words)
    config = tomllib.loads(done.output)["router"]["segments"]["hub"]["config"]
    assert config == json.loads(CliRunner().invoke(make_app("agent"), [*words, "--format=json"]).output)
    assert config["access_control"]["subjects"][1] == {"id": "controller", "usernames": ["alice"]}
    assert "@riot/r7/agent/**" in done.output
    assert config["downsampling"][0]["messages"] == ["query"]


def test_roles_that_are_none() -> None:
    assert parse_subject("viewer") == ("viewer", "viewer")
    assert parse_subject("agent=a=b") == ("agent", "a=b")
    with pytest.raises(ConfigError, match="no role 'viewr'") as caught:
        parse_subject("viewr=x")
    assert "viewer" in (caught.value.hint or "")


def test_an_agent_needs_its_folder() -> None:
    result = CliRunner().invoke(make_app("agent"), ["agent"])
    assert isinstance(result.exception, ConfigError)
    assert "no folder of logs is named" in str(result.exception)
