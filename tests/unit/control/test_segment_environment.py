from __future__ import annotations

import json
from pathlib import Path

import pytest

from riot_bus.control.segment_environment import (
    endpoints_of,
    export,
    exported_endpoints,
    segment_variables,
    write_session_files,
)
from riot_bus.vocabulary.errors import ConfigError

TWO = {"system": ("tcp/127.0.0.1:41234",), "unit": ("tcp/127.0.0.1:41235", "unixsock-stream//tmp/a b.sock")}
OVERRIDE = 'mode="client";connect/endpoints=["tcp/127.0.0.1:41235"];scouting/multicast/enabled=false'


def test_what_is_exported_is_read_again(tmp_path: Path) -> None:
    variables = export(TWO, files=tmp_path, domains={"unit": 42})
    assert variables["RIOT_ENDPOINTS"].startswith("system=tcp/127.0.0.1:41234 ")
    assert exported_endpoints(variables) == TWO
    assert exported_endpoints({}) == {}
    assert endpoints_of("system", variables) == TWO["system"]


def test_a_component_of_a_segment_finds_it_whoever_it_is(tmp_path: Path) -> None:
    write_session_files(TWO, tmp_path)
    found = segment_variables("unit", {"PATH": "/bin", **export(TWO, files=tmp_path)})
    assert found == {
        "RMW_IMPLEMENTATION": "rmw_zenoh_cpp",
        "ZENOH_CONFIG_OVERRIDE": OVERRIDE,
        "ZENOH_CONFIG": str(tmp_path / "zenoh-unit.json5"),
        "RIOT_ENDPOINT": "tcp/127.0.0.1:41235",
        "RMW_TEST_FIXTURE_DISABLE_ISOLATION": "1",
        "DISABLE_ROS_ISOLATION": "1",
    }
    file = tmp_path / "zenoh-unit.json5"
    assert json.loads(file.read_text())["connect"] == {"endpoints": list(TWO["unit"])}
    assert file.stat().st_mode & 0o777 == 0o600
    assert sorted(path.name for path in tmp_path.iterdir()) == ["zenoh-system.json5", "zenoh-unit.json5"]


def test_from_one_segment_into_the_other() -> None:
    inside = {**export(TWO), **segment_variables("system", export(TWO))}
    assert segment_variables("unit", inside)["ZENOH_CONFIG_OVERRIDE"] == OVERRIDE


def test_other_settings_of_the_user_stay() -> None:
    environ = {"ZENOH_CONFIG_OVERRIDE": 'mode="peer"; transport/shared_memory/enabled=true', **export(TWO)}
    found = segment_variables("unit", environ)["ZENOH_CONFIG_OVERRIDE"]
    assert found == f" transport/shared_memory/enabled=true;{OVERRIDE}"


def test_behind_a_bridge_the_middleware_is_the_users() -> None:
    found = segment_variables("unit", {"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", **export(TWO, domains={"unit": 42})})
    assert found["ROS_DOMAIN_ID"] == "42"
    assert "RMW_IMPLEMENTATION" not in found


def test_what_rmw_zenoh_cannot_reach_is_reached_by_others() -> None:
    found = segment_variables("unit", export({"unit": ["ws/127.0.0.1:7449"]}))
    assert found["RIOT_ENDPOINT"] == "ws/127.0.0.1:7449"
    assert not {"ZENOH_CONFIG_OVERRIDE", "RMW_IMPLEMENTATION"} & found.keys()


@pytest.mark.parametrize(
    ("environ", "match"),
    [
        ({}, "no segment 'unit'.*\n.*opens a router"),
        (export({"unti": ["tcp/127.0.0.1:1"]}), "no segment 'unit'\n.*did you mean 'unti'"),
        ({"RIOT_ENDPOINTS": "unit"}, "RIOT_ENDPOINTS: 'unit' is not a segment and its endpoints"),
        ({"RIOT_ENDPOINTS": "unit='"}, "RIOT_ENDPOINTS: cannot be parsed"),
        (export({"unit": ["tcp/127.0.0.1:0"]}), "is chosen when the router starts"),
        ({**export(TWO), "RIOT_DOMAINS": "unit=many"}, "RIOT_DOMAINS: unit: 'many' is not a ROS domain"),
    ],
)
def test_what_cannot_be_used_is_said(environ: dict[str, str], match: str) -> None:
    with pytest.raises(ConfigError, match=match):
        segment_variables("unit", environ)


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"gone/zenoh-unit.json5: cannot write the configuration: No such file"):
        write_session_files({"unit": ["tcp/127.0.0.1:1"]}, tmp_path / "gone")
