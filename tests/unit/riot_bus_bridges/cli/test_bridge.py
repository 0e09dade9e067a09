"""Bridges are commands of other packages, found by name."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable

import pytest
from typer.testing import CliRunner, Result

from riot_bus.cli.main import make_app
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, RiotError
from riot_bus_bridges.bridging import OwnRouter
from riot_bus_bridges.cli.bridge import BridgeHost

TOY = '''
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from riot_bus_bridges.bridging import Bridge
from riot_bus.vocabulary.flags import Flag


@dataclass
class ToyOptions:
    speed: Annotated[int, Flag("Of toys.", "-s")] = 1


class ToyBridge(Bridge):
    def __init__(self, speed):
        super().__init__()
        self.speed = speed

    def open(self, stack):
        stack.callback(print, "toys are put away")
        self.stop()

    def status(self):
        return {"speed": self.speed}

    def ready(self):
        return "ready: toys"

    def summary(self):
        return ["no toy crossed"]

    def words(self):
        return {"speed": str(self.speed)}


def toy(
    context: typer.Context,
    program: Annotated[list[str] | None, typer.Argument()] = None,
    *,
    segment: str = "unit",
    options: ToyOptions,
    system: Path | None = None,
    cfg: list[str] | None = None,
    form: str = "text",
) -> None:
    """Join toys to a segment."""
    context.obj.ports([segment], system=system, cfg=cfg or ())
    context.obj.run(ToyBridge(options.speed), program=program or (), as_json=form == "json")
'''


def riot(*words: str) -> Result:
    return CliRunner().invoke(make_app("bridge"), ["bridge", *words])


def test_a_bridge_of_others_is_a_command(plugin_package: Callable[..., str]) -> None:
    plugin_package(TOY, "riot_bus.bridges", toy="toy")
    assert "toy      Join toys to a segment." in riot("--help").output
    listed = riot("toy", "--help").output
    assert all(text in listed for text in ("Of toys.", "--system FILE", "--cfg KEY=VALUE", "--format <text|json>"))
    assert riot("toy").output == "ready: toys\ntoys are put away\nno toy crossed\n"
    lines = riot("toy", "--speed=3", "--format=json").output.replace("toys are put away\n", "").splitlines()
    assert [json.loads(line) for line in lines] == [{"event": "ready", "speed": 3}, {"event": "ended", "speed": 3}]
    assert isinstance(riot("toy", "--cfg=nonsense").exception, ConfigError)


def test_a_broken_bridge_is_listed_and_says_why_where_it_is_named(plugin_package: Callable[..., str]) -> None:
    plugin_package("import no_such_module", "riot_bus.bridges", broken="toy")
    assert "Cannot be loaded: bridge 'broken'" in " ".join(riot("--help").output.split())
    result = riot("broken", "--speed", "3", "x")
    assert isinstance(result.exception, RiotError)
    assert "no_such_module" in str(result.exception)


def test_an_unknown_bridge_is_a_wrong_command() -> None:
    result = riot("toy")
    assert result.exit_code == 2
    assert "No such command 'toy'" in result.output


@pytest.mark.parametrize("words", [["--help"], ["bridge", "--help"], ["bridge", "mavlink", "--help"]])
def test_help_imports_commands_at_most(words: list[str]) -> None:
    code = f"""
import sys
from riot_bus.cli.main import run
sys.argv = ["riot", *{words}]
try:
    run()
except SystemExit:
    pass
heavy = {{"zenoh", "numpy", "pymavlink", "rosbags", "riot_bus_ros2.adapter", "riot_bus_bridges.mavlink.bridge"}}
sys.exit(", ".join(sorted(heavy & set(sys.modules))) or None)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_segments_are_known_by_name_or_place() -> None:
    assert list(BridgeHost().ports(["system", "x=tcp/127.0.0.1:1"])) == ["system", "x"]
    assert BridgeHost().segments(OwnRouter(segments=["a=tcp/127.0.0.1:0", "b=tcp/127.0.0.1:0"])) == ["a", "b"]
    with pytest.raises(ConfigError, match="nosuch"):
        BridgeHost().ports(["nosuch"])
    (port,) = BridgeHost().ports([], "tcp/127.0.0.1:1").values()
    with pytest.raises(EnvironmentFaultError), port:
        pytest.fail("nobody listens there")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["ros2"], "which segment"),
        (["ros2", "--segment=a", "--endpoint=b"], "which segment"),
        (["mavlink", "--segment=a", "--endpoint=b"], "which segment"),
        (["mavlink", "--segment=a", "--segment=a=tcp/127.0.0.1:1"], "'a' is named twice"),
        (["mavlink", "--segment=a", "--record=x.mcap"], "--record is for a bridge that is its own router"),
        (["mavlink", "--cfg=a=b"], "--cfg is for a router elsewhere"),
        (["mavlink"], "no link to be bridged"),
    ],
)
def test_options_that_do_not_go_together(words: list[str], message: str) -> None:
    result = riot(*words)
    assert isinstance(result.exception, ConfigError)
    assert message in str(result.exception)


def test_a_variable_for_clients_does_not_disturb_a_bridge_that_is_its_own_router(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("RIOT_CLIENT_CFG", "timestamping/enabled=true")
    assert "no link to be bridged" in str(riot("mavlink").exception)
