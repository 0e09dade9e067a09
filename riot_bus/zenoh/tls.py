"""Diagnosis of failed TLS links: Zenoh reports only that there is no answer, so the handshake is repeated."""

from __future__ import annotations

import socket
import ssl
from collections.abc import Mapping
from typing import Any

from riot_bus.config.endpoints import parse_endpoint
from riot_bus.vocabulary.errors import RiotError
from riot_bus.zenoh.session_config import ANSWER_S

_TLS = "transport/link/tls"


def why_refused(endpoint: str, config: Mapping[str, Any]) -> str | None:
    """Return the reason why a handshake fails; None if it succeeds, or if the endpoint is not TLS over TCP."""
    try:
        where = parse_endpoint(endpoint, connect=True)
    except RiotError:
        return None
    if where.protocol != "tls":
        return None
    given = {key.removesuffix("_file"): value for key, value in where.parameters.items()}

    def setting(name: str) -> Any:
        return given.get(name, config.get(f"{_TLS}/{name}"))

    try:
        context = ssl.create_default_context(cafile=setting("root_ca_certificate"))
        context.check_hostname = setting("verify_name_on_connect") is not False
        if setting("connect_certificate"):
            context.load_cert_chain(setting("connect_certificate"), setting("connect_private_key"))
        with (
            socket.create_connection((where.host, where.port), ANSWER_S) as plain,
            context.wrap_socket(plain, server_hostname=where.host) as link,
        ):
            link.settimeout(0.5)  # in TLS 1.3, an alert about the client's certificate comes after the handshake
            link.recv(1)
    except ssl.SSLCertVerificationError as error:
        return f"its certificate is refused: {error.verify_message}"
    except ssl.SSLError as error:
        return f"TLS: {(error.reason or str(error)).replace('_', ' ').lower()}"
    except (OSError, ValueError):  # the port is closed, or all is well and it waits for us
        return None
    return None
