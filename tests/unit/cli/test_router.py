"""What the command line of `riot router`, `router env` and `exec` leads to; what they call are doubles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner, Result

from riot_bus.cli import router
from riot_bus.control.router_flags import RouterOptions


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    found: list[Any] = []

    def start(given: dict[str, Any], *, as_json: bool) -> None:
        found.append((RouterOptions(**given), as_json))

    def environment(*arguments: Any, **options: Any) -> tuple[list[str], list[str]]:
        found.append((arguments, options))
        return ["export A=1", "export B=2"], ["set C"]

    def environ_in(segment: str, environ: Any, *, hint: Any, **options: Any) -> dict[str, str]:
        found.append((segment, options))
        hint("no router yet")
        return {"A": "1"}

    monkeypatch.setattr(router, "start_router", start)
    monkeypatch.setattr("riot_bus.control.component.component_environment", environment)
    monkeypatch.setattr("riot_bus.control.segment_exec.environment_in", environ_in)
    monkeypatch.setattr("riot_bus.control.segment_exec.become", lambda *each: found.append(each))
    return found


def riot(*words: str, **environment: str) -> Result:
    app = typer.Typer(rich_markup_mode=None)
    router.register(app)
    return CliRunner().invoke(app, words, env=environment)


def test_only_what_is_given_reaches_the_router(calls: list[Any]) -> None:
    assert riot("router").exit_code == 0
    words = [
        "--segment",
        "a=tcp/x:1",
        "--segment",
        "b=tcp/y:2",
        "--no-bypass-watch",
        "--budget",
        "2",
        "--format",
        "json",
    ]
    assert riot("router", *words, RIOT_NAME="base").exit_code == 0
    (nothing, no_json), (some, as_json) = calls
    assert (nothing, no_json) == (RouterOptions(), False)
    assert (list(some.segments), some.bypass_watch, some.budget, some.name) == (
        ["a=tcp/x:1", "b=tcp/y:2"],
        False,
        2.0,
        "base",
    )
    assert as_json


def test_an_environment_is_printed_apart_from_hints_and_starts_no_router(calls: list[Any]) -> None:
    result = riot(
        "router", "env", "unit", "--flavour", "zenoh", "--host", "h", "--cfg", "a=1", "--segment", "unit=tcp/x:1"
    )
    assert result.stdout == "export A=1\nexport B=2\n"
    assert result.stderr == "hint: set C\n"
    (((segment, flavour, options), more),) = calls
    assert (segment, flavour, list(options.segments)) == ("unit", "zenoh", ["unit=tcp/x:1"])
    assert (more["host"], list(more["cfg"]), more["file"]) == ("h", ["a=1"], None)
    assert riot("router", "env", "unit", "--flavour", "dds").exit_code == 2


def test_options_after_the_command_are_the_commands_own(calls: list[Any]) -> None:
    result = riot("exec", "--segment", "unit", "-s", "a.toml", "ros2", "run", "--segment", "x", "-s")
    assert result.exit_code == 0, result.output
    (segment, options), (command, environ) = calls
    assert (segment, options["system"]) == ("unit", Path("a.toml"))
    assert (command, environ) == (["ros2", "run", "--segment", "x", "-s"], {"A": "1"})
    assert "hint: no router yet" in result.stderr
