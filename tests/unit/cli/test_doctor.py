"""What `riot doctor` prints, and when it says that something would spoil a run."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import pytest
import typer
from typer.testing import CliRunner, Result

from riot_bus.cli import doctor
from riot_bus.doctor.checks import Check
from riot_bus.vocabulary.errors import EnvironmentFaultError

BAD = EnvironmentFaultError.exit_code
FINE, WARNING = Check("versions", "ok", "all new"), Check("files", "warning", "few", "allow more")


@dataclass
class Verdict:
    """How a router compares with a plain one."""

    differences: int

    def __str__(self) -> str:
        return f"{self.differences} differences"


@dataclass
class Access:
    """Something that an identity could do."""

    needed: bool | None
    identity: str = "viewer"
    action: str = "put"
    key: str = "/a"
    seen_by: tuple[str, ...] = ("agent",)


def riot(*words: str) -> Result:
    app = typer.Typer(rich_markup_mode=None)
    for command in (doctor.doctor, doctor.interceptors):
        app.command(command.__name__)(command)
    return CliRunner().invoke(app, words)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the checks are to find, and what they were asked."""
    found: dict[str, Any] = {"checks": [FINE, WARNING], "transparency": [Verdict(0)], "access": [], "say": None}

    def check(*, endpoints: Any, scouting: Any) -> list[Check]:
        found["endpoints"], found["scouting"] = list(endpoints), scouting
        return found["checks"]

    def transparency(ends: tuple[str, str]) -> Any:
        found["ends"] = ends
        return found["transparency"]

    def access(endpoint: str, configs: dict[str, Any], *, robot: str | None, say: Any) -> list[Access]:
        found["acl"] = (endpoint, configs, robot)
        return found["access"]

    monkeypatch.setattr("riot_bus.doctor.checks.check", check)
    monkeypatch.setattr(doctor, "hook", lambda name, _: {"transparency": transparency, "access": access}[name])
    return found


def test_warnings_are_shown_with_their_cure_but_spoil_nothing(asked: dict[str, Any]) -> None:
    result = riot("doctor", "--listen", "tcp/a:1", "--listen", "tcp/b:2", "--no-scouting")
    assert result.output.splitlines() == [
        "ok       versions: all new",
        "warning  files: few",
        "         cure: allow more",
    ]
    assert result.exit_code == 0
    assert (asked["endpoints"], asked["scouting"]) == (["tcp/a:1", "tcp/b:2"], None)
    riot("doctor")
    assert (asked["endpoints"], asked["scouting"] is None) == ([], False)


def test_a_problem_has_its_exit_code_in_each_form(asked: dict[str, Any]) -> None:
    asked["checks"] = [Check("port", "problem", "taken", "another")]
    assert riot("doctor").exit_code == BAD
    result = riot("doctor", "--format", "json")
    assert result.exit_code == BAD
    document = json.loads(result.output)
    assert document == {
        "checks": [{"name": "port", "status": "problem", "text": "taken", "cure": "another"}],
        "transparency": [],
    }


def test_a_router_that_is_not_transparent_is_a_problem(asked: dict[str, Any]) -> None:
    assert riot("doctor", "--transparency", "tcp/a:1", "tcp/b:2").exit_code == 0
    assert asked["ends"] == ("tcp/a:1", "tcp/b:2")
    asked["transparency"] = [Verdict(0), Verdict(2)]
    result = riot("doctor", "--transparency", "tcp/a:1", "tcp/b:2")
    assert result.output.splitlines()[-1] == "2 differences"
    assert result.exit_code == BAD


def test_identities_are_tried_with_all_their_settings(asked: dict[str, Any]) -> None:
    asked["access"] = [Access(True), Access(None, identity="nobody")]
    words = [
        "--identity",
        "viewer:mode=client",
        "--identity",
        "viewer:connect/timeout_ms=5",
        "--identity",
        "b:mode=peer",
    ]
    result = riot("doctor", "--acl", "tcp/a:1", *words, "--robot", "r1")
    endpoint, configs, robot = asked["acl"]
    assert (endpoint, robot, list(configs)) == ("tcp/a:1", "r1", ["viewer", "b"])
    assert configs["viewer"]["mode"] == "client"
    assert len(configs["viewer"]) == 2
    assert result.exit_code == 0
    assert result.output.splitlines() == [
        "ok       viewer: put /a (seen with agent)",
        "         nobody: put /a (seen with agent)",
        "2 things were seen; 0 of them no role needs. What is not listed was not seen.",
    ]


def test_what_no_role_needs_is_a_problem(asked: dict[str, Any]) -> None:
    asked["access"] = [Access(True), Access(False)]
    result = riot("doctor", "--acl", "tcp/a:1")
    assert result.exit_code == BAD
    assert "problem  viewer: put /a" in result.output
    assert "1 of them no role needs" in result.output


def test_interceptors_are_listed_with_their_options(monkeypatch: pytest.MonkeyPatch) -> None:
    options = [
        {"name": "rate", "doc": "How fast.", "type": "float", "default": "2"},
        {"name": "mode", "doc": "", "type": "str", "default": None},
    ]
    rows = [{"name": "throttle", "summary": "Slows.", "options": options}]
    monkeypatch.setattr("riot_bus.interceptors.catalogue.interceptor_list", lambda: rows)
    expected = ["throttle: Slows.", "    rate: How fast. (default 2)", "    mode: str"]
    assert riot("interceptors").output.splitlines() == expected
    assert json.loads(riot("interceptors", "--format", "json").output) == rows
