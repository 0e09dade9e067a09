from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from riot_bus.config.router_settings import SegmentSettings
from riot_bus.control.environment import (
    client_settings,
    environment,
    environment_lines,
    missing_for_clients,
    override,
    reachable,
    session_file,
)
from riot_bus.vocabulary.errors import ConfigError

TLS = "transport/link/tls"
USERS = "transport/auth/usrpwd"


def test_ros_nodes_become_clients_without_multicast() -> None:
    lines = environment_lines("unit", ["tcp/127.0.0.1:7448"], "rmw_zenoh")
    assert lines == [
        "# segment unit, for ROS 2 nodes",
        "export RMW_IMPLEMENTATION=rmw_zenoh_cpp",
        "export ZENOH_CONFIG_OVERRIDE="
        """'mode="client";connect/endpoints=["tcp/127.0.0.1:7448"];scouting/multicast/enabled=false'""",
    ]


def test_programs_of_their_own_get_a_file(tmp_path: Path) -> None:
    file = tmp_path / "it's.json5"
    _, line = environment_lines("unit", ["tcp/127.0.0.1:7448"], "zenoh", file=file)
    told = subprocess.run(["sh", "-c", f'{line}; echo "$ZENOH_CONFIG"'], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == str(file)
    assert json.loads(session_file(client_settings(["tcp/127.0.0.1:7448"]))) == {
        "mode": "client",
        "connect": {"endpoints": ["tcp/127.0.0.1:7448"]},
        "scouting": {"multicast": {"enabled": False}},
    }


@pytest.mark.parametrize("file", [None, Path("zenoh.conf")])
def test_zenoh_tells_files_by_their_ending(file: Path | None) -> None:
    with pytest.raises(ConfigError, match="json5"):
        environment(["tcp/127.0.0.1:1"], "zenoh", file=file)


def test_semicolons_in_values_do_not_separate() -> None:
    text = override({"connect/endpoints": ["tcp/h:1?a=1;b=2"]})
    assert text == r'connect/endpoints=["tcp/h:1?a=1\u003bb=2"]'


def test_wildcards_become_addresses_and_listener_settings_stay_at_home() -> None:
    listen = ["tcp/0.0.0.0:1?rel=1#iface=eth0", "tcp/[::]:2", "tcp/127.0.0.1:3", "unixsock-stream//tmp/x"]
    assert reachable(listen) == ["tcp/127.0.0.1:1?rel=1", "tcp/[::1]:2", "tcp/127.0.0.1:3", "unixsock-stream//tmp/x"]
    assert reachable(listen, flavour="rmw_zenoh") == ["tcp/127.0.0.1:1?rel=1", "tcp/[::1]:2", "tcp/127.0.0.1:3"]
    assert reachable(listen, host="robot") == ["tcp/robot:1?rel=1", "tcp/robot:2"]
    assert reachable(["tcp/[::]:2"], host="fe80::1") == ["tcp/[fe80::1]:2"]


@pytest.mark.parametrize(
    ("listen", "options", "words"),
    [
        ([], {}, "no endpoint for zenoh among none"),
        (["quic/127.0.0.1:1"], {"flavour": "rmw_zenoh"}, "no endpoint for rmw_zenoh among quic"),
        (["tcp/127.0.0.1:1"], {"host": "robot"}, "from other machines"),
        (["tcp/127.0.0.1:0"], {}, "chosen when the router starts"),
    ],
)
def test_what_cannot_be_reached_is_said(listen: list[str], options: dict[str, str], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        reachable(listen, **options)  # type: ignore[arg-type]


def test_what_the_segment_asks_for() -> None:
    open_ = SegmentSettings(listen=("tcp/127.0.0.1:1",))
    assert missing_for_clients(open_, {}) == ({}, [])
    mutual = SegmentSettings(
        listen=("tls/127.0.0.1:1",), config={f"{TLS}/root_ca_certificate": "/ca.pem", f"{TLS}/enable_mtls": True}
    )
    known, hints = missing_for_clients(mutual, {f"{TLS}/connect_certificate": "/me.pem"})
    assert known[f"{TLS}/root_ca_certificate"] == "/ca.pem"
    assert known[f"{TLS}/enable_mtls"] is True
    assert [hint.split("--cfg ")[1] for hint in hints] == [f"{TLS}/connect_private_key=FILE.pem"]
    users = SegmentSettings(listen=("quic/127.0.0.1:1",), config={f"{USERS}/dictionary_file": "/users"})
    _, hints = missing_for_clients(users, {})
    assert [hint.split("--cfg ")[1].split("=")[0] for hint in hints] == [
        f"{TLS}/root_ca_certificate",
        f"{USERS}/user",
        f"{USERS}/password",
    ]
