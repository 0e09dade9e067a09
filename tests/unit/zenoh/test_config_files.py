"""Secrets come from files that nobody else may read."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.config.router_settings import RouterSettings
from riot_bus.control.component import client_cfg
from riot_bus.control.router_flags import RouterFlags, merged
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.config_files import TLS, USERS, endpoint_files

PASSWORD = f"{USERS}/password"


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    path = tmp_path / "password"
    path.touch(0o600)
    path.write_text("1234\n")
    return path


def test_a_value_is_read_from_a_file(secret: Path) -> None:
    assert client_cfg([f"{PASSWORD}=@{secret}"]) == {PASSWORD: "1234"}
    assert client_cfg([f"{PASSWORD}=@password"], cwd=secret.parent) == {PASSWORD: "1234"}
    with pytest.raises(ConfigError, match="timestamping/enabled"):
        merged(RouterSettings(), RouterFlags(cfg=[f"system:timestamping/enabled=@{secret}"]))


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o666])
def test_a_file_that_others_may_read_is_refused(secret: Path, mode: int) -> None:
    secret.chmod(mode)
    with pytest.raises(ConfigError, match=rf"others may read the secrets in \S+ \(mode {mode:o}\)") as caught:
        client_cfg([f"{PASSWORD}=@{secret}"])
    assert caught.value.hint == f"chmod 600 {secret}"
    for key in (f"{TLS}/connect_private_key", f"{TLS}/listen_private_key", f"{USERS}/dictionary_file"):
        with pytest.raises(ConfigError, match="others may read"):
            client_cfg([f"{key}={secret}"])
    with pytest.raises(ConfigError, match="others may read"):
        endpoint_files(f"tls/h:1#listen_private_key_file={secret}", Path(), where="x")
    assert client_cfg([f"{TLS}/root_ca_certificate={secret}"])  # what is public may be read


def test_a_file_that_is_none(tmp_path: Path, secret: Path) -> None:
    with pytest.raises(ConfigError, match="there is no file"):
        client_cfg([f"{PASSWORD}=@{tmp_path / 'nosuch'}"])
    secret.write_bytes(b"\xff")
    with pytest.raises(ConfigError, match="cannot read"):
        client_cfg([f"{PASSWORD}=@{secret}"])
    secret.write_text("x" * 100_000)
    with pytest.raises(ConfigError, match="is longer than 65536 letters"):
        client_cfg([f"{PASSWORD}=@{secret}"])


def test_no_page_puts_a_password_on_a_command_line() -> None:
    root = Path(__file__).resolve().parents[3]
    pages = [
        root / "README.md",
        *(path for name in ("docs", "deploy", "examples") for path in (root / name).rglob("*")),
    ]
    for path in pages:
        for line in path.read_text(errors="ignore").splitlines() if path.is_file() else ():
            assert "usrpwd/password=" not in line or "usrpwd/password=@" in line, f"{path}: {line}"
