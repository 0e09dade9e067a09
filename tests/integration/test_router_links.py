"""Every protocol and every kind of authentication, with real sessions and the settings that users are shown."""

from __future__ import annotations

import contextlib
import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from riot_bus.config.router_settings import SegmentSettings
from riot_bus.control.environment import (
    client_settings,
    environment,
    environment_lines,
    missing_for_clients,
    reachable,
    session_file,
)
from riot_bus.control.router_flags import RouterOptions
from riot_bus.control.router_options import load_router, merged
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import open_session, release, wait_until
from riot_bus.zenoh.session_config import router_config
from tests.integration.access_tools import write_private

pytestmark = pytest.mark.integration

TLS = "transport/link/tls"
USERS = "transport/auth/usrpwd"
CERTIFICATE = {f"{TLS}/listen_certificate": "server.pem", f"{TLS}/listen_private_key": "server.key"}
PLAIN = ["tcp", "udp", "ws", "unixsock-stream"]


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an authority, and certificates of a server and a client that it has signed."""
    folder = tmp_path_factory.mktemp("keys")

    def openssl(*arguments: str) -> None:
        subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True, timeout=60)

    new = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    openssl("req", "-x509", *new, "-keyout", "ca.key", "-out", "ca.pem", "-subj", "/CN=authority", "-days", "2")
    (folder / "ext").write_text("subjectAltName=DNS:localhost,IP:127.0.0.1\nbasicConstraints=CA:FALSE\n")
    for name in ("server", "client"):
        openssl("req", *new, "-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", f"/CN={name}")
        signed = ["-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-days", "2", "-extfile", "ext"]
        openssl("x509", "-req", "-in", f"{name}.csr", *signed, "-out", f"{name}.pem")
    return folder


def free(protocol: str, folder: Path) -> str:
    if protocol == "unixsock-stream":
        return f"{protocol}/{folder}/x.sock"
    kind = socket.SOCK_DGRAM if protocol in ("udp", "quic") else socket.SOCK_STREAM
    with socket.socket(type=kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{protocol}/127.0.0.1:{probe.getsockname()[1]}"


def segment(folder: Path, endpoint: str, config: dict[str, Any], **more: Any) -> SegmentSettings:
    """What a riot.toml in this folder makes of a segment."""
    table = {"listen": [endpoint], **more}
    lines = ["[router.segments.a]", *(f"{key} = {json.dumps(value)}" for key, value in table.items())]
    lines += ["[router.segments.a.config]", *(f'"{key}" = {toml(value)}' for key, value in config.items())]
    path = folder / "riot.toml"
    path.write_text("\n".join(lines))
    return merged(load_router(path), RouterOptions()).segment("a")


def toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(each)}" for key, each in value.items()) + "}"
    return f"[{', '.join(toml(each) for each in value)}]" if isinstance(value, list) else json.dumps(value)


@contextlib.contextmanager
def router(settings: SegmentSettings) -> Iterator[zenoh.Session]:
    config = router_config(listen=settings.listen, connect=settings.connect, extra=settings.config)
    try:
        session = open_session(config, purpose="segment 'a'")
    except EnvironmentFaultError as error:
        if "not supported" in str(error):
            pytest.skip(str(error))
        raise
    try:
        yield session
    finally:
        release(session)


@contextlib.contextmanager
def component(
    settings: SegmentSettings, config: dict[str, Any], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[zenoh.Session]:
    """A program that takes its configuration from the environment that is printed for it."""
    endpoints = reachable(settings.listen)
    file = folder / "zenoh-a.json5"
    file.write_text(session_file(client_settings(endpoints, config)))
    for name, value in environment(endpoints, "zenoh", file=file).items():
        monkeypatch.setenv(name, value)
    session = zenoh.open(zenoh.Config.from_env())
    try:
        yield session
    finally:
        release(session)


def connected(
    settings: SegmentSettings, config: dict[str, Any], folder: Path, monkeypatch: pytest.MonkeyPatch, router: Any
) -> bool:
    try:
        with component(settings, config, folder, monkeypatch) as session:
            return router.info.zid() in session.info.routers_zid()
    except zenoh.ZError:
        return False


@pytest.mark.parametrize("protocol", PLAIN)
def test_plain_protocols(protocol: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = segment(tmp_path, free(protocol, tmp_path), {})
    with router(settings) as session:
        config, hints = missing_for_clients(settings, {})
        assert hints == []
        assert connected(settings, config, tmp_path, monkeypatch, session)


@pytest.mark.parametrize("protocol", ["tls", "quic"])
def test_encryption(protocol: str, keys: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = segment(keys, free(protocol, keys), CERTIFICATE)
    with router(settings) as session:
        needed, hints = missing_for_clients(settings, {})
        assert len(hints) == 1
        assert not connected(settings, needed, keys, monkeypatch, session)
        right = {f"{TLS}/root_ca_certificate": str(keys / "ca.pem")}
        assert missing_for_clients(settings, right) == (right, [])
        assert connected(settings, right, keys, monkeypatch, session)


@pytest.mark.parametrize("protocol", ["tls", "quic"])
def test_mutual_authentication(protocol: str, keys: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mutual = {**CERTIFICATE, f"{TLS}/root_ca_certificate": "ca.pem", f"{TLS}/enable_mtls": True}
    settings = segment(keys, free(protocol, keys), mutual)
    with router(settings) as session:
        needed, hints = missing_for_clients(settings, {})
        assert len(hints) == 2
        assert not connected(settings, needed, keys, monkeypatch, session)
        mine = {f"{TLS}/connect_{kind}": str(keys / f"client.{end}") for kind, end in KINDS.items()}
        needed, hints = missing_for_clients(settings, mine)
        assert hints == []
        assert connected(settings, needed, keys, monkeypatch, session)


KINDS = {"certificate": "pem", "private_key": "key"}


def test_certificate_in_the_endpoint(keys: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    endpoint = free("tls", keys) + "#listen_certificate_file=server.pem;listen_private_key_file=server.key"
    settings = segment(keys, endpoint, {})
    with router(settings) as session:
        right = {f"{TLS}/root_ca_certificate": str(keys / "ca.pem")}
        assert connected(settings, right, keys, monkeypatch, session)


def test_users_and_passwords(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_private(tmp_path / "users.txt", "bob:s3;cr=et\n")
    settings = segment(tmp_path, free("tcp", tmp_path), {f"{USERS}/dictionary_file": "users.txt"})
    with router(settings) as session:
        needed, hints = missing_for_clients(settings, {})
        assert len(hints) == 2
        assert not connected(settings, needed, tmp_path, monkeypatch, session)
        wrong = {f"{USERS}/user": "bob", f"{USERS}/password": "guess"}
        assert not connected(settings, wrong, tmp_path, monkeypatch, session)
        right = {f"{USERS}/user": "bob", f"{USERS}/password": "s3;cr=et"}
        assert connected(settings, right, tmp_path, monkeypatch, session)


def test_access_control_by_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_private(tmp_path / "users.txt", "bob:secret\n")
    rule = {
        "id": "drive",
        "permission": "allow",
        "flows": ["ingress", "egress"],
        "messages": ["put", "declare_subscriber"],
        "key_exprs": ["cmd/**"],
    }
    control = {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule],
        "subjects": [{"id": "bob", "usernames": ["bob"]}],
        "policies": [{"rules": ["drive"], "subjects": ["bob"]}],
    }
    config = {f"{USERS}/dictionary_file": "users.txt", "access_control": control}
    settings = segment(tmp_path, free("tcp", tmp_path), config)
    bob = {f"{USERS}/user": "bob", f"{USERS}/password": "secret"}
    with router(settings) as session, component(settings, bob, tmp_path, monkeypatch) as client:
        arrived: list[str] = []
        session.declare_subscriber("**", lambda sample: arrived.append(str(sample.key_expr)))
        client.put("status/x", "1")
        client.put("cmd/go", "1")
        assert wait_until(lambda: "cmd/go" in arrived, 60)
        assert arrived == ["cmd/go"]


def test_joining_a_router_that_comes_later(tmp_path: Path) -> None:
    outside = segment(tmp_path, free("tcp", tmp_path), {})
    inside = segment(tmp_path, free("tcp", tmp_path), {}, connect=list(outside.listen))
    with router(inside) as session, router(outside) as other:
        assert wait_until(lambda: other.info.zid() in session.info.routers_zid(), 60)
        release(other)
        # Zenoh 1.10.2 panics in a router that is closed while it takes in that another one has left.
        assert wait_until(lambda: not session.info.transports(), 60)


def test_a_shell_starts_a_component(tmp_path: Path) -> None:
    settings = segment(tmp_path, free("tcp", tmp_path), {})
    endpoints = reachable(settings.listen)
    file = tmp_path / "zenoh a.json5"
    file.write_text(session_file(client_settings(endpoints)))
    lines = environment_lines("a", endpoints, "zenoh", file=file)
    program = "import zenoh; s = zenoh.open(zenoh.Config.from_env()); print(*s.info.routers_zid()); s.close()"
    with router(settings) as session:
        script = "\n".join([*lines, 'exec "$0" -c "$1"'])
        told = subprocess.run(
            ["sh", "-c", script, sys.executable, program], capture_output=True, text=True, timeout=60, check=True
        )
        assert told.stdout.split() == [str(session.info.zid())]


def test_a_ros_node_would_connect(tmp_path: Path) -> None:
    settings = segment(tmp_path, free("tcp", tmp_path), {})
    variables = environment(reachable(settings.listen, flavour="rmw_zenoh"), "rmw_zenoh")
    config = zenoh.Config()
    for key, value in {"connect/endpoints": ["tcp/localhost:7447"], "listen/endpoints": ["tcp/localhost:0"]}.items():
        config.insert_json5(key, json.dumps(value))  # as in rmw_zenoh's default session configuration
    for pair in variables["ZENOH_CONFIG_OVERRIDE"].split(";"):  # as rmw_zenoh reads it
        key, _, text = pair.partition("=")
        config.insert_json5(key, text)
    with router(settings) as session:
        node = zenoh.open(config)
        assert list(node.info.routers_zid()) == [session.info.zid()]
        release(node)
