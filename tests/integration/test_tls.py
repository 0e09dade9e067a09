"""TLS and mutual TLS as they are used: who is not who it should be is refused, and says why."""

from __future__ import annotations

import shutil
import socket
import ssl
import subprocess
from pathlib import Path
from typing import Any

import pytest

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import free_endpoint, wait_until
from tests.integration.agent_tools import Process
from tests.integration.router_process import RouterProcess
from tests.tiers import chosen

pytestmark = [
    pytest.mark.integration,
    pytest.mark.skipif(shutil.which("openssl") is None, reason="makes certificates with openssl"),
]

TLS = "transport/link/tls"
NAMES = {"right": "IP:127.0.0.1", "expired": "IP:127.0.0.1", "elsewhere": "DNS:elsewhere", "stranger": "IP:127.0.0.1"}
ROUTERS = {
    "expired": "certificate has expired",
    "elsewhere": "IP address mismatch",
    "stranger": "self-signed|unable to get",
}
CLIENTS = {"": "certificate required", "expired": "certificate expired", "stranger": "unknown ca"}
"""Certificates by which a router does not let a client in; the first is none at all."""
_UNUSED = 9


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two authorities, and a key and a certificate of each kind."""
    folder = tmp_path_factory.mktemp("keys")

    def openssl(*arguments: str) -> None:
        subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True, timeout=30)

    new = ("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
    for authority in ("ours", "theirs"):
        openssl(
            *new,
            "-x509",
            "-days",
            "2",
            "-subj",
            f"/CN={authority}",
            "-keyout",
            f"{authority}.key",
            "-out",
            f"{authority}.pem",
        )
    for name, place in NAMES.items():
        authority = "theirs" if name == "stranger" else "ours"
        (folder / "extensions.txt").write_text(f"subjectAltName={place}\nbasicConstraints=CA:FALSE\n")
        openssl(*new, "-subj", f"/CN={name}", "-keyout", f"{name}.key", "-out", f"{name}.csr")
        signed = ("-CA", f"{authority}.pem", "-CAkey", f"{authority}.key", "-CAcreateserial")
        days = "-1" if name == "expired" else "2"
        openssl(
            "x509",
            "-req",
            "-in",
            f"{name}.csr",
            *signed,
            "-days",
            days,
            "-extfile",
            "extensions.txt",
            "-out",
            f"{name}.pem",
        )
    for key in folder.glob("*.key"):
        key.chmod(0o600)
    return folder


def router(keys: Path, name: str, *options: str) -> RouterProcess:
    """A router whose segment `system` has one of the certificates."""
    settings = {f"{TLS}/listen_certificate": f"{name}.pem", f"{TLS}/listen_private_key": f"{name}.key"}
    return RouterProcess(
        *(f"--cfg=system:{key}={keys / value}" for key, value in settings.items()),
        *options,
        endpoints={"system": "tls/127.0.0.1:0", "unit": "tcp/127.0.0.1:0"},
    )


def mutual(keys: Path) -> RouterProcess:
    return router(
        keys,
        "right",
        f"--cfg=system:{TLS}/root_ca_certificate={keys / 'ours.pem'}",
        f"--cfg=system:{TLS}/enable_mtls=true",
    )


def client(keys: Path, name: str = "", **more: Any) -> dict[str, Any]:
    found = {f"{TLS}/root_ca_certificate": str(keys / "ours.pem"), **more}
    if name:
        ends = {"certificate": "pem", "private_key": "key"}
        found |= {f"{TLS}/connect_{kind}": str(keys / f"{name}.{end}") for kind, end in ends.items()}
        found |= {f"{TLS}/enable_mtls": True}
    return found


def cfg(config: dict[str, Any], option: str = "--cfg") -> list[str]:
    return [f"{option}={key}={str(value).lower() if value is True else value}" for key, value in config.items()]


def passes(endpoint: str, config: dict[str, Any]) -> bool:
    """Return whether two clients hear each other."""
    with open_client(endpoint, config=config) as source, open_client(endpoint, config=config) as sink:
        heard: list[Message] = []
        sink.subscribe("a", heard.append)

        def told() -> bool:
            source.put(Message(0, "a", b"x"))
            return bool(heard)

        return wait_until(told, 60, interval=0.05)


def test_who_is_who_it_should_be_is_let_in(keys: Path) -> None:
    with router(keys, "right") as found:
        assert passes(found.endpoints["system"], client(keys))
    with mutual(keys) as found:
        assert passes(found.endpoints["system"], client(keys, "right"))


@pytest.mark.parametrize("name", chosen(ROUTERS, gate=("elsewhere", "stranger")))
def test_a_router_that_is_not_who_it_should_be_is_refused(keys: Path, tmp_path: Path, name: str) -> None:
    with router(keys, name) as found:
        endpoint = found.endpoints["system"]
        with pytest.raises(EnvironmentFaultError, match=ROUTERS[name]):
            open_client(endpoint, config=client(keys))
        for words in _programs(endpoint, cfg(client(keys)), tmp_path):
            with Process(*words) as process:
                assert "its certificate is refused" in process.expect("no link to tls/")


@pytest.mark.parametrize("name", chosen(CLIENTS, gate=("", "expired")))
def test_a_client_that_is_not_who_it_should_be_is_refused(keys: Path, tmp_path: Path, name: str) -> None:
    with mutual(keys) as found:
        endpoint = found.endpoints["system"]
        with pytest.raises(EnvironmentFaultError, match=CLIENTS[name]):
            open_client(endpoint, config=client(keys, name))
        for words in _programs(endpoint, cfg(client(keys, name)), tmp_path):
            with Process(*words) as process:
                assert CLIENTS[name] in process.expect("no link to tls/")


def _programs(endpoint: str, options: list[str], folder: Path) -> list[list[str]]:
    """Return command lines of an agent, a recorder, a question and bridges, each of which connects there."""
    fleet = [each.replace("--cfg", "--fleet-cfg", 1) for each in options]
    return [
        ["agent", f"--logs={folder}", "--robot=r7", f"--endpoint={free_endpoint()}", f"--fleet={endpoint}", *fleet],
        ["record", f"--endpoint={endpoint}", f"--output={folder / 'x.mcap'}", *options],
        ["ctl", f"--endpoint={endpoint}", *options, "status"],
        ["bridge", "ros2", f"--endpoint={endpoint}", *options],
        ["bridge", "mavlink", f"--link=udpout:127.0.0.1:{_UNUSED}", f"--endpoint={endpoint}", *options],
    ]


def test_a_link_without_encryption_is_refused(keys: Path) -> None:
    with router(keys, "right") as found:
        host, _, port = found.endpoints["system"].removeprefix("tls/").partition(":")
        with pytest.raises(EnvironmentFaultError):
            open_client(f"tcp/{host}:{port}")
        assert passes(found.endpoints["system"], client(keys))


@pytest.mark.filterwarnings("ignore:ssl.TLSVersion:DeprecationWarning")
def test_an_old_version_of_tls_is_refused(keys: Path) -> None:
    with router(keys, "right") as found:
        host, _, port = found.endpoints["system"].removeprefix("tls/").partition(":")
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        context.set_ciphers("ALL:@SECLEVEL=0")
        context.minimum_version, context.maximum_version = ssl.TLSVersion.TLSv1, ssl.TLSVersion.TLSv1_1
        with socket.create_connection((host, int(port)), 10) as plain, pytest.raises((ssl.SSLError, ConnectionError)):
            context.wrap_socket(plain, server_hostname=host)
        assert passes(found.endpoints["system"], client(keys))
