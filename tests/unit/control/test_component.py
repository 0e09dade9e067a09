from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from riot_bus.cli.main import make_app
from riot_bus.config.router_settings import RouterSettings
from riot_bus.control.component import client_cfg, component_environment
from riot_bus.control.router_flags import RouterOptions
from riot_bus.control.router_options import merged
from riot_bus.vocabulary.errors import ConfigError

PASSWORD = "transport/auth/usrpwd/password"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "password").touch(0o600)
    (tmp_path / "password").write_text("s3kR1t\n")
    (tmp_path / "open").write_text("s3kR1t\n")
    (tmp_path / "open").chmod(0o644)
    return tmp_path


def test_passwords_come_from_files(folder: Path) -> None:
    assert client_cfg([f"{PASSWORD}=@password"]) == {PASSWORD: "s3kR1t"}
    with pytest.raises(ConfigError, match=r"--fleet-cfg: .*others may read") as caught:
        client_cfg([f"{PASSWORD}=@open"], where="--fleet-cfg")
    assert "s3kR1t" not in str(caught.value)
    key = "transport/link/tls/listen_private_key_base64"
    settings = merged(RouterSettings(), RouterOptions(cfg=[f"unit:{key}=@password"]), cwd=folder)
    assert settings.segment("unit").config == {key: "s3kR1t"}


def test_what_a_component_needs_is_whole(folder: Path) -> None:
    lines, _ = component_environment("unit", "rmw_zenoh", RouterOptions(), cfg=[f"{PASSWORD}=@password"])
    assert f'{PASSWORD}="s3kR1t"' in lines[-1]
    component_environment("unit", "zenoh", RouterOptions(), cfg=[f"{PASSWORD}=@password"], file=folder / "unit.json5")
    assert '"password": "s3kR1t"' in (folder / "unit.json5").read_text()


def commands(group: typer.core.TyperGroup, *words: str) -> dict[str, dict[str, str | None]]:
    """Return the variables of the options by which commands take settings of Zenoh."""
    found = {}
    own = {name: each.envvar for each in group.params for name in each.opts if name in ("--cfg", "--fleet-cfg")}
    if own:
        found[" ".join(words)] = own
    for name in getattr(group, "commands", {}):
        found |= commands(group.commands[name], *words, name)
    return found


def test_variables_stand_for_all_settings_of_clients() -> None:
    app = typer.main.get_group(make_app())
    found = commands(app)
    bridges = app.commands["bridge"]
    for name in ("mavlink", "ros2"):
        found |= commands(bridges.get_command(None, name), "bridge", name)
    assert found.pop("router") == {"--cfg": "RIOT_CFG"}
    for name in ("router env", "exec"):
        assert found.pop(name) == {"--cfg": None}  # of a component, not of whoever asks
    assert found.pop("agent") == {"--cfg": "RIOT_CLIENT_CFG", "--fleet-cfg": "RIOT_FLEET_CFG"}
    assert {"ctl", "graph", "init", "play", "record", "fleet play", "bridge ros2", "bridge mavlink"} <= set(found)
    assert all(each == {"--cfg": "RIOT_CLIENT_CFG"} for each in found.values())


@pytest.mark.parametrize(
    ("words", "variable", "where"),
    [
        (["ctl", "status"], "RIOT_CLIENT_CFG", "--cfg: "),
        (["fleet", "robots"], "RIOT_CLIENT_CFG", "--cfg: "),
        (["agent", "--logs=."], "RIOT_CLIENT_CFG", "--cfg: "),
        (["agent", "--logs=."], "RIOT_FLEET_CFG", "--fleet-cfg: "),
    ],
)
def test_variables_are_split_at_white_space(folder: Path, words: list[str], variable: str, where: str) -> None:
    value = f"{PASSWORD}=@password  {PASSWORD}=@open"
    error = CliRunner().invoke(make_app(words[0]), words, env={variable: value}).exception
    assert isinstance(error, ConfigError)
    assert str(error).startswith(where)
    assert f"others may read {folder}/open" in str(error)
