from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.config.router_settings import RouterSettings
from riot_bus.control.component import client_cfg
from riot_bus.control.router_flags import RouterOptions
from riot_bus.control.router_options import (
    interceptors_of,
    parse_types,
    plan_of,
    registry_of,
    settings_of,
)
from riot_bus.pipeline.conditions import Selective
from riot_bus.vocabulary.errors import ConfigError


def test_types() -> None:
    assert parse_types(["/odom=nav_msgs/msg/Odometry"]) == {"/odom": "nav_msgs/msg/Odometry"}
    with pytest.raises(ConfigError, match="TOPIC=TYPE"):
        parse_types(["odom"])


def test_riot_toml_of_the_working_folder_is_read_if_it_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert settings_of(RouterOptions()).name == "router"
    (tmp_path / "riot.toml").write_text("[router]\nname = 'lab'\n")
    assert settings_of(RouterOptions()).name == "lab"
    with pytest.raises(ConfigError, match="cannot read the system file"):
        settings_of(RouterOptions(system=Path("other.toml")))


def test_interceptors_of_file_and_options_are_in_order_and_get_the_seed() -> None:
    settings = RouterSettings(interceptors=({"use": "drop", "every": 2, "seed": 3}, {"use": "drop", "every": 3}))
    options = RouterOptions(interceptors=["delay seconds=1 select=/odom"], seed=7)
    made = interceptors_of(settings, options)
    assert all(isinstance(each, Selective) for each in made)
    assert [each.when.seed for each in made if isinstance(each, Selective)] == [3, 7, 7]
    with pytest.raises(ConfigError, match=r"router\.interceptors\[0\]"):
        interceptors_of(RouterSettings(interceptors=({"use": "dorp"},)), RouterOptions())


def test_a_plan_that_cannot_be_read_is_an_error(tmp_path: Path) -> None:
    assert plan_of(RouterOptions()) is None
    with pytest.raises(ConfigError, match="cannot read the injection plan"):
        plan_of(RouterOptions(inject=tmp_path / "no.toml"))
    (tmp_path / "empty.toml").write_text("seed = 1")
    with pytest.raises(ConfigError, match="injects nothing"):
        plan_of(RouterOptions(inject=tmp_path / "empty.toml"))


def test_settings_of_clients_are_keys_and_values(tmp_path: Path) -> None:
    (tmp_path / "ca.pem").write_text("")
    found = client_cfg(["transport/link/tls/root_ca_certificate=ca.pem", "timestamping/enabled=true"], cwd=tmp_path)
    assert found == {
        "transport/link/tls/root_ca_certificate": str(tmp_path / "ca.pem"),
        "timestamping/enabled": True,
    }
    with pytest.raises(ConfigError, match="write KEY=VALUE"):
        client_cfg(["nonsense"])


def test_types_and_adapters_of_riot_toml_count_for_the_router(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    message = tmp_path / "my_msgs/msg/Odd.msg"
    message.parent.mkdir(parents=True)
    message.write_text("float64 x\n")
    (tmp_path / "riot.toml").write_text(
        "[system]\nadapters = ['ros2dds']\nmessages = ['my_msgs/msg/Odd.msg']\n"
        "types = { '/odd' = 'my_msgs/msg/Odd', '/odom' = 'nav_msgs/msg/Path' }\n"
    )
    registry = registry_of(RouterOptions(system=tmp_path / "riot.toml", types=["/odom=nav_msgs/msg/Odometry"]))
    assert registry.key_expression("/odd") == "odd"
    names = [kind.name for key in ("odd", "odom") if (kind := registry.type_of(key)) is not None]
    assert names == ["my_msgs/msg/Odd", "nav_msgs/msg/Odometry"]
    monkeypatch.chdir(tmp_path)
    assert registry_of(RouterOptions()).topic("odd") == "/odd"
    monkeypatch.setenv("RIOT_ADAPTERS", "ros2")
    assert registry_of(RouterOptions()).topic("odd") == "odd"


@pytest.mark.parametrize(
    "text", ["system = 1", "[system]\ntypes = 1", "[system]\nmessages = [1]", "[system]\nadapters = 'x'"]
)
def test_what_is_not_usable_in_riot_toml(tmp_path: Path, text: str) -> None:
    (tmp_path / "riot.toml").write_text(text)
    with pytest.raises(ConfigError, match="not usable"):
        registry_of(RouterOptions(system=tmp_path / "riot.toml"))
