from __future__ import annotations

import re
import subprocess
import sys
import textwrap
from contextlib import nullcontext
from pathlib import Path

import pytest

from riot_bus.config.endpoints import parse_endpoint
from riot_bus.config.router_settings import DEFAULT_SEGMENTS, RouterSettings, SegmentSettings
from riot_bus.control.component import client_cfg
from riot_bus.control.exposure import bridge_warnings, exposure_warnings
from riot_bus.control.router_flags import RouterOptions
from riot_bus.control.router_options import load_router, merged, parse_cfg
from riot_bus.system.system_file import load_system
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.config_keys import leaves, value_of
from riot_bus.zenoh.session_config import client_config

TLS = "transport/link/tls"
FULL = """
[router]
name = "lab"
intercept = ["/odom"]
record = "run.mcap"
budget = 0.5

[router.segments.system]
listen = ["tcp/127.0.0.1:7447", "unixsock-stream//tmp/x.sock"]
connect = ["tcp/192.168.0.9:7447"]

[router.segments.system.config]
"transport/link/tx/lease" = 5000

[router.segments.unit]
listen = ["udp/127.0.0.1:7447"]

[[router.interceptors]]
use = "drop"
probability = 0.5
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "riot.toml"
    path.write_text(text)
    return path


def test_a_whole_router_loads_without_components(tmp_path: Path) -> None:
    settings = load_router(write(tmp_path, FULL))
    assert (settings.name, settings.intercept, settings.budget) == ("lab", ("/odom",), 0.5)
    assert settings.record == str(tmp_path / "run.mcap")
    assert settings.segment("system").connect == ("tcp/192.168.0.9:7447",)
    assert settings.segment("system").config == {"transport/link/tx/lease": 5000}
    assert settings.interceptors == ({"use": "drop", "probability": 0.5},)
    with pytest.raises(ConfigError, match="did you mean 'system'"):
        settings.segment("sistem")


def test_other_tables_are_left_to_others(tmp_path: Path) -> None:
    assert load_router(write(tmp_path, "[components.one]\nnonsense = 1")) == RouterSettings()


def test_a_system_file_may_have_a_router(tmp_path: Path) -> None:
    components = '\n[components.one]\ncommand = ["true"]\n'
    file = load_system(write(tmp_path, FULL + components))
    assert file.router is not None
    assert file.router.name == "lab"
    assert load_system(write(tmp_path, components)).router is None
    with pytest.raises(ConfigError, match=r"riot.toml:9: \[router.segments.system\]: unknown key 'lisen'.*\n.*listen"):
        load_system(write(tmp_path, FULL.replace("listen", "lisen", 1) + components))


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ('name = "lab"', 'nam = "lab"', 3, ("unknown key 'nam'", "'name'")),
        ('name = "lab"', 'name = "a/b"', 3, ("pattern", "'a/b'")),
        ("budget = 0.5", "budget = 0", 6, ("greater than 0",)),
        ('intercept = ["/odom"]', 'intercept = "/odom"', 4, ("tuple", "'/odom'")),
        ("listen = [", "lissen = [", 9, ("unknown key 'lissen'", "'listen'")),
        ("tcp/127.0.0.1:7447", "tpc/127.0.0.1:7447", 9, ("unknown protocol 'tpc'", "'tcp'")),
        ("tcp/127.0.0.1:7447", "tcp/127.0.0.1", 9, ("has no port", "tcp/127.0.0.1:7447")),
        ("tcp/127.0.0.1:7447", "127.0.0.1:7447", 9, ("is not an endpoint",)),
        ("tcp/127.0.0.1:7447", "tls/127.0.0.1:7447#listen_certificate_file=no.pem", 9, ("there is no file", "no.pem")),
        ("tcp/192.168.0.9:7447", "tcp/192.168.0.9:0", 10, ("no client can connect",)),
        ("tcp/192.168.0.9:7447", "tcp/localhost:7447", 10, ("segment 'system' of this router",)),
        ("udp/127.0.0.1:7447", "tls/0.0.0.0:7447", 16, ("'system' and 'unit' both listen",)),
        ("udp/127.0.0.1:7447", "unixsock-stream//tmp/x.sock", 16, ("both listen",)),
        ("tx/lease", "tx/leese", 13, ("no key 'transport/link/tx/leese'", "'transport/link/tx/lease'")),
        ("5000", '"long"', 13, ("refuses", '"long"')),
        ("5000", "1979-05-27", 13, ("no such value",)),
        ('"transport/link/tx/lease" = 5000', '"mode" = "peer"', 13, ("cannot be set here", "always a router")),
        ('"transport/link/tx/lease" = 5000', '"adminspace/enabled" = false', 13, ("cannot be false",)),
        (
            '"transport/link/tx/lease" = 5000',
            '"adminspace" = {enabled = false}',
            13,
            ("'adminspace/enabled'", "be false"),
        ),
        ('"transport/link/tx/lease" = 5000', '"transport/auth/usrpwd/user" = "a"', 13, ("without a password",)),
        ('"transport/link/tx/lease" = 5000', f'"{TLS}/root_ca_certificate" = "ca.pem"', 13, ("no file", "/ca.pem")),
    ],
)
def test_mistakes_are_named_with_their_place(
    tmp_path: Path, old: str, new: str, line: int, words: tuple[str, ...]
) -> None:
    assert old in FULL
    with pytest.raises(ConfigError) as caught:
        load_router(write(tmp_path, FULL.replace(old, new, 1)))
    text = str(caught.value)
    assert f"riot.toml:{line}" in text, text
    for word in words:
        assert word in text


def test_one_way_out_for_two_segments_is_a_mistake() -> None:
    outside = SegmentSettings(connect=("tcp/10.0.0.1:7447",))
    with pytest.raises(ValueError, match="both connect"):
        RouterSettings(segments={"a": outside, "b": outside})


def test_paths_start_from_the_folder_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "keys").mkdir()
    for name in ("cert.pem", "key.pem"):
        (tmp_path / "keys" / name).touch(0o600)
    path = write(
        tmp_path,
        "[router.segments.a]\n"
        'listen = ["tls/127.0.0.1:7447#listen_private_key_file=keys/key.pem;so_rcvbuf=9000"]\n'
        "[router.segments.a.config.transport.link.tls]\n"
        'listen_certificate = "keys/cert.pem"\n',
    )
    segment = merged(load_router(path), RouterOptions()).segment("a")
    assert segment.config == {f"{TLS}/listen_certificate": str(tmp_path / "keys/cert.pem")}
    assert segment.listen == (f"tls/127.0.0.1:7447#listen_private_key_file={tmp_path}/keys/key.pem;so_rcvbuf=9000",)


def test_the_examples_of_the_documentation_load(tmp_path: Path) -> None:
    for name in ("server.pem", "server.key", "ca.pem", "users.txt"):
        (tmp_path / name).touch(0o600)
    text = (Path(__file__).parents[3] / "docs/router.md").read_text()
    blocks = [textwrap.dedent(block).strip() for block in re.findall(r"(?:^(?: {4}.*)?\n)+", text, re.MULTILINE)]
    examples = [block for block in blocks if block.startswith("[router")]
    assert len(examples) >= 6
    for example in examples:
        assert load_router(write(tmp_path, example)).segments


def test_defaults_listen_on_loopback_alone() -> None:
    settings = merged(RouterSettings(), RouterOptions())
    assert settings.segments == DEFAULT_SEGMENTS
    assert exposure_warnings(settings) == []
    assert all(endpoint.is_local for each in settings.segments.values() for endpoint in each.listeners)


def test_options_win_over_the_file(tmp_path: Path) -> None:
    flags = RouterOptions(
        segments=["system=tcp/127.0.0.1:1,tcp/[::1]:1", "new=tcp/127.0.0.1:2"],
        connect=["system=tcp/10.0.0.1:7447?rel=1#iface=eth0;so_sndbuf=1"],
        cfg=["system:transport/link/tx/lease=7000"],
        name="bench",
        intercept=["/scan"],
        record=Path("b.mcap"),
        budget=2.0,
    )
    settings = merged(load_router(write(tmp_path, FULL)), flags, cwd=tmp_path / "work")
    assert (settings.name, settings.intercept, settings.budget) == ("bench", ("/scan",), 2.0)
    assert settings.record == str(tmp_path / "work/b.mcap")
    assert settings.segment("system").listen == ("tcp/127.0.0.1:1", "tcp/[::1]:1")
    assert settings.segment("system").connect == ("tcp/10.0.0.1:7447?rel=1#iface=eth0;so_sndbuf=1",)
    assert settings.segment("system").config == {"transport/link/tx/lease": 7000}
    assert settings.segment("unit").listen == ("udp/127.0.0.1:7447",)
    assert list(settings.segments) == ["system", "unit", "new"]


def test_segments_of_the_command_line_replace_the_default_ones() -> None:
    assert list(merged(RouterSettings(), RouterOptions(segments=["a=tcp/127.0.0.1:1"])).segments) == ["a"]


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (RouterOptions(segments=["a"]), ("--segment", "NAME=ENDPOINT")),
        (RouterOptions(segments=["a=,"]), ("--segment", "NAME=ENDPOINT")),
        (RouterOptions(segments=["a=tcp/x:1,tpc/y:2"]), ("--segment a", "'tpc'", "did you mean 'tcp'")),
        (RouterOptions(segments=["a=tcp/x:1", "b=tcp/0.0.0.0:1"]), ("router.segments.b", "both listen")),
        (RouterOptions(segments=["a=tls/127.0.0.1:1"]), ("needs a listen certificate", f"--cfg a:{TLS}")),
        (RouterOptions(connect=["systen=tcp/x:1"]), ("--connect", "no segment 'systen'", "did you mean 'system'")),
        (RouterOptions(cfg=["unti:transport/link/tx/lease=1"]), ("--cfg", "did you mean 'unit'")),
        (RouterOptions(cfg=["transport/link/tx/lease=1"]), ("--cfg", "SEGMENT:KEY=VALUE")),
        (RouterOptions(cfg=["unit:transport/link/tx/leas=1"]), ("--cfg unit", "did you mean")),
        (RouterOptions(cfg=["unit:mode=client"]), ("--cfg unit", "cannot be set here")),
        (RouterOptions(cfg=[f"unit:{TLS}/listen_certificate=no.pem"]), ("--cfg unit", "there is no file")),
        (RouterOptions(name="a b"), ("--name", "'a b'")),
        (RouterOptions(budget=-1), ("--budget", "-1")),
    ],
)
def test_wrong_options(flags: RouterOptions, words: tuple[str, ...]) -> None:
    with pytest.raises(ConfigError) as caught:
        merged(RouterSettings(), flags)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("tcp/", "is not an endpoint"),
        ("TCP/127.0.0.1:1", "did you mean 'tcp'"),
        ("serial//dev/ttyS0", "unknown protocol 'serial'"),
        ("tcp/:1", "has no host"),
        ("tcp/::1:7447", "brackets"),
        ("tcp/[::1]", "brackets"),
        ("tcp/h:70000", "not a port"),
        ("tcp/h:a", "not a port"),
        ("unixsock-stream/x.sock", "no absolute path"),
        ("unixsock-stream//" + "x" * 120, "too long"),
    ],
)
def test_wrong_endpoints(text: str, reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        parse_endpoint(text)


@pytest.mark.parametrize(
    ("text", "local"),
    [
        ("tcp/127.0.0.1:1", True),
        ("tcp/127.8.0.1:1", True),
        ("tcp/LOCALHOST:1", True),
        ("quic/[::1]:1", True),
        ("tcp/[::ffff:127.0.0.1]:1", True),
        ("unixsock-stream//tmp/x", True),
        ("tcp/0.0.0.0:1", False),
        ("tcp/[::]:1", False),
        ("udp/192.168.0.1:1", False),
        ("tcp/robot.local:1", False),
    ],
)
def test_what_only_this_machine_reaches(text: str, local: bool) -> None:
    assert parse_endpoint(text).is_local is local


@pytest.mark.parametrize(
    ("config", "warned"),
    [
        ({}, ["tcp/0.0.0.0:1"]),
        ({"access_control/enabled": True}, []),
        ({"access_control": {"enabled": True}}, []),
        ({"access_control": {"enabled": False}}, ["tcp/0.0.0.0:1"]),
        ({"transport/auth/usrpwd/dictionary_file": "users"}, []),
        ({f"{TLS}/listen_certificate": "c"}, ["tcp/0.0.0.0:1"]),
    ],
)
def test_open_listeners_are_named(config: dict[str, object], warned: list[str]) -> None:
    listen = ("tcp/127.0.0.1:1", "tcp/0.0.0.0:1", "tls/0.0.0.0:2")
    lines = exposure_warnings(RouterSettings(segments={"a": SegmentSettings(listen=listen, config=config)}))
    assert [line.split()[4].rstrip(":") for line in lines] == warned
    assert all("segment 'a'" in line for line in lines)


@pytest.mark.parametrize(
    ("key", "text", "value"),
    [
        ("scouting/delay", "0x10", 16),
        ("scouting/multicast/enabled", "true", True),
        ("transport/link/protocols", "['tcp', \"tls\",]", ["tcp", "tls"]),
        ("transport/auth/usrpwd/user", "bob", "bob"),
        ("transport/auth/usrpwd/user", "'bob'", "bob"),
        ("transport/auth/usrpwd/password", "1234", "1234"),
        ("transport/auth/usrpwd/password", "a=b;c:d", "a=b;c:d"),
        ("metadata", "{name: 'x'} // note", {"name": "x"}),
    ],
)
def test_values_are_json5_or_text(key: str, text: str, value: object) -> None:
    assert value_of(key, text, where="--cfg a") == value


def test_open_links_of_a_bridge_are_named_in_the_same_words() -> None:
    line, _ = bridge_warnings(["udp/0.0.0.0:14550", "tcp/127.0.0.1:5760", "udp/[::1]:14550", "udp/[fe80::1%eth0]:0"])
    assert line.startswith("a link listens on udp/0.0.0.0:14550: any host that reaches it can read and write every")


@pytest.mark.parametrize(
    ("option", "refused"),
    [
        ("transport/auth/usrpwd/password=wonder", True),
        ("/transport/auth/usrpwd/password=wonder", True),
        ('transport/auth/usrpwd={user:"a",password:"wonder"}', True),
        ("transport/link/tls/connect_private_key_base64=AAAA", True),
        ("transport/auth/usrpwd/user=alice", False),
    ],
)
def test_a_secret_is_refused_on_a_command_line_not_in_the_environment(
    option: str, monkeypatch: pytest.MonkeyPatch, *, refused: bool
) -> None:
    assert client_cfg([option]), "from RIOT_CLIENT_CFG"
    for words in (["ctl", "--cfg", option], ["play", f"--cfg={option}"], ["doctor", "--identity", f"robot:{option}"]):
        monkeypatch.setattr("sys.argv", ["riot", *words])
        with pytest.raises(ConfigError, match="see command lines") if refused else nullcontext():
            client_cfg([option])


def test_a_segment_takes_no_secret_from_a_command_line(monkeypatch: pytest.MonkeyPatch) -> None:
    option = "system:transport/link/tls/listen_private_key_base64=AAAA"
    assert merged(RouterSettings(), RouterOptions(cfg=(option,))), "from RIOT_CFG"
    monkeypatch.setattr("sys.argv", ["riot", "router", f"--cfg={option}"])
    with pytest.raises(ConfigError, match="see command lines") as problem:
        merged(RouterSettings(), RouterOptions(cfg=(option,)))
    assert "AAAA" not in str(problem.value)


def test_a_key_in_an_endpoint_is_refused_on_a_command_line(monkeypatch: pytest.MonkeyPatch) -> None:
    endpoint = "tls/127.0.0.1:1#connect_private_key_base64=AAAA"
    assert client_config(endpoint)["connect/endpoints"] == [endpoint]
    monkeypatch.setattr("sys.argv", ["riot", "ctl", "-e", endpoint])
    with pytest.raises(ConfigError, match="connect_private_key_base64 is a secret") as problem:
        client_config(endpoint)
    assert "AAAA" not in str(problem.value)


def test_values_that_zenoh_refuses() -> None:
    with pytest.raises(ConfigError, match="refuses soon for 'scouting/delay'"):
        value_of("scouting/delay", "soon", where="--cfg a")


def test_tables_are_taken_apart_where_zenoh_has_tables() -> None:
    nested = {
        "/transport/link": {"tx": {"lease": 1}, "protocols": ["tcp"]},
        "timestamping": {"enabled": {"peer": True}},
    }
    assert leaves(nested) == {
        "transport/link/tx/lease": 1,
        "transport/link/protocols": ["tcp"],
        "timestamping/enabled": {"peer": True},
    }


def test_a_router_without_a_file_does_not_wait_for_what_only_others_need() -> None:
    code = """
import sys
import riot_bus.control.router_process, riot_bus.control.router_service
from riot_bus.control.router_flags import RouterOptions
from riot_bus.control.router_options import registry_of, settings_of
options = RouterOptions()
settings_of(options), registry_of(options)
print([name for name in ("pydantic", "ssl", "rich", "mcap") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == "[]"


def test_settings_split_at_the_first_colon_and_equals_sign() -> None:
    assert parse_cfg("a:/x/y=b:c=d") == ("a", "x/y", "b:c=d")
