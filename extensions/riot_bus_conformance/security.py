"""Configuration of routers and components for links that are encrypted or require a password."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.segments import EPHEMERAL

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from riot_bus_conformance.scenario import Need

_TLS = "transport/link/tls"
_PASSWORD = "transport/auth/usrpwd"  # noqa: S105 - a configuration key
_CERTIFICATES = ("router", "component")


@dataclass(frozen=True)
class Settings:
    """Listening endpoint of a network, and Zenoh configuration of its routers and of the ends."""

    listen: str = EPHEMERAL
    router: dict[str, Any] = field(default_factory=dict)
    end: dict[str, Any] = field(default_factory=dict)


def settings_for(needs: Collection[Need], folder: Path) -> Settings:
    """Return the settings that meet the needs of a scenario.

    Raises:
        EnvironmentFaultError: Certificates are needed, and there is no `openssl` command.
    """
    if "tls" in needs or "mtls" in needs:
        return _tls(folder, mutual="mtls" in needs)
    if "password" in needs:
        users = folder / "users.txt"
        users.touch(0o600)
        users.write_text("rover:marvin\n", encoding="utf-8")
        me = {f"{_PASSWORD}/user": "rover", f"{_PASSWORD}/password": "marvin"}
        return Settings(router={f"{_PASSWORD}/dictionary_file": str(users)}, end=me)
    if "shm" in needs:
        shared = {"transport/shared_memory/enabled": True}
        return Settings(router=shared, end=shared)
    return Settings()


def _tls(folder: Path, *, mutual: bool) -> Settings:
    make_certificates(folder)
    authority = {f"{_TLS}/root_ca_certificate": str(folder / "authority.pem")}
    router = {
        **authority,
        f"{_TLS}/listen_private_key": str(folder / "router.key"),
        f"{_TLS}/listen_certificate": str(folder / "router.pem"),
        f"{_TLS}/enable_mtls": mutual,
    }
    end: dict[str, Any] = {**authority, f"{_TLS}/enable_mtls": mutual}
    if mutual:
        for side, name in ((router, "router"), (end, "component")):
            side[f"{_TLS}/connect_private_key"] = str(folder / f"{name}.key")
            side[f"{_TLS}/connect_certificate"] = str(folder / f"{name}.pem")
    return Settings("tls/127.0.0.1:0", router, end)


def make_certificates(folder: Path) -> None:
    """Write an authority, and loopback keys and certificates for a router and a component, unless they exist."""
    if (folder / "component.pem").exists():
        return
    openssl = shutil.which("openssl")
    if openssl is None:
        raise EnvironmentFaultError("there is no openssl command", where="PATH", hint="install openssl")

    def run(*arguments: str) -> None:
        subprocess.run([openssl, *arguments], cwd=folder, check=True, capture_output=True, timeout=30)

    new = ("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
    run(*new, "-x509", "-days", "2", "-subj", "/CN=authority", "-keyout", "authority.key", "-out", "authority.pem")
    extensions = folder / "extensions.txt"
    extensions.write_text("subjectAltName=IP:127.0.0.1,DNS:localhost\nbasicConstraints=CA:FALSE\n", encoding="utf-8")
    for name in _CERTIFICATES:
        run(*new, "-subj", f"/CN={name}", "-keyout", f"{name}.key", "-out", f"{name}.csr")
        signed = ("-CA", "authority.pem", "-CAkey", "authority.key", "-CAcreateserial", "-days", "2")
        run("x509", "-req", "-in", f"{name}.csr", *signed, "-extfile", extensions.name, "-out", f"{name}.pem")
