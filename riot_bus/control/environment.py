"""`riot router env SEGMENT`: the environment in which a component uses a segment of the router."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

from riot_bus.config.endpoints import ENCRYPTED, Endpoint, parse_endpoint
from riot_bus.new_file import write_whole
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.config_files import TLS, USERS
from riot_bus.zenoh.config_keys import leaves

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from riot_bus.config.router_settings import SegmentSettings
    from riot_bus.zenoh.session_config import SessionConfig

Flavour = Literal["rmw_zenoh", "zenoh"]
"""Programs that read the environment: nodes of ROS 2 under `rmw_zenoh_cpp`, or programs that use Zenoh themselves."""

_ROS_PROTOCOLS = frozenset({"tcp", "tls", "udp"})  # what rmw_zenoh's own build of Zenoh has
_LOOPBACK = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}  # noqa: S104 - compared, not listened on


def reachable(listen: Sequence[str], *, flavour: Flavour = "zenoh", host: str | None = None) -> list[str]:
    """Return where components connect, for the endpoints that a segment listens on.

    Raises:
        ConfigError: None of them can be reached, or its port is known only to the running router.
    """
    endpoints = [parse_endpoint(text) for text in listen]
    if flavour == "rmw_zenoh":
        endpoints = [endpoint for endpoint in endpoints if endpoint.protocol in _ROS_PROTOCOLS]
    if host is not None:
        endpoints = [endpoint for endpoint in endpoints if not endpoint.is_local]
    if not endpoints:
        who = " from other machines" if host is not None else ""
        hint = "let the segment listen on such as tcp/127.0.0.1:7447, or tcp/0.0.0.0:7447 for other machines"
        raise ConfigError(f"no endpoint for {flavour}{who} among {', '.join(listen) or 'none'}", hint=hint)
    return [str(_target(endpoint, host)) for endpoint in endpoints]


def _target(endpoint: Endpoint, host: str | None) -> Endpoint:
    if endpoint.protocol in _ROS_PROTOCOLS | ENCRYPTED | {"ws"} and endpoint.port == 0:
        hint = "give the segment a port, such as 7447; the router prints the present one when it starts"
        raise ConfigError(f"the port of {endpoint} is chosen when the router starts", hint=hint)
    address = endpoint.address
    if endpoint.is_wildcard:
        address = f"{_bracketed(host) if host else _LOOPBACK[endpoint.host]}:{endpoint.port}"
    return replace(endpoint, address=address, config="")  # the config part is about the listener


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host and not host.startswith("[") else host


def client_settings(endpoints: Sequence[str], config: Mapping[str, Any] | None = None) -> SessionConfig:
    """Return the Zenoh configuration of a component.

    It is a client, since only then does everything pass the router, and does without multicast scouting, by which
    components on one machine find each other around every router.
    """
    return {
        "mode": "client",
        "connect/endpoints": list(endpoints),
        "scouting/multicast/enabled": False,
        **(config or {}),
    }


def missing_for_clients(segment: SegmentSettings, config: Mapping[str, Any]) -> tuple[SessionConfig, list[str]]:
    """Return what a component needs beyond an endpoint: settings known from the segment, and hints for the others."""
    known, hints = dict(config), []
    if any(endpoint.protocol in ENCRYPTED for endpoint in segment.listeners):
        authority = f"{TLS}/root_ca_certificate"
        if authority in segment.config:
            known.setdefault(authority, segment.config[authority])
        elif authority not in known:
            hints.append(f"unless a public authority signed the certificate: --cfg {authority}=CA.pem")
        if segment.config.get(f"{TLS}/enable_mtls"):
            hints += [
                f"the segment wants to know who connects: --cfg {TLS}/{key}=FILE.pem"
                for key in ("connect_certificate", "connect_private_key")
                if f"{TLS}/{key}" not in known
            ]
            known.setdefault(f"{TLS}/enable_mtls", True)
    if segment.config.get(f"{USERS}/dictionary_file"):
        hints += [
            f"the segment asks for a {key}: --cfg {USERS}/{key}={value}"
            for key, value in (("user", "..."), ("password", "@FILE"))
            if f"{USERS}/{key}" not in known
        ]
    return known, hints


def override(settings: SessionConfig) -> str:
    """Return settings in the format of `ZENOH_CONFIG_OVERRIDE`: `key=value;key=value`, values as JSON.

    rmw_zenoh splits at every `;`, so in values it is written as its JSON escape.
    """
    pairs = ((key, json.dumps(value, separators=(",", ":"))) for key, value in settings.items())
    return ";".join(f"{key}={value}".replace(";", "\\u003b") for key, value in pairs)


def session_file(settings: SessionConfig) -> str:
    """Return settings as the text of a configuration file for `ZENOH_CONFIG`, as JSON."""
    tree: dict[str, Any] = {}
    for key, value in leaves(settings).items():
        *tables, name = key.split("/")
        table = tree
        for each in tables:
            table = table.setdefault(each, {})
        table[name] = value
    return json.dumps(tree, indent=2) + "\n"


def write_session_file(path: Path, settings: SessionConfig) -> None:
    """Write settings as a file for `ZENOH_CONFIG` that only this user can read, and that is never half written.

    Raises:
        ConfigError: The file cannot be written.
    """
    try:
        write_whole(path, session_file(settings), mode=0o600, sync=False)
    except OSError as error:
        raise ConfigError(f"cannot write the configuration: {error.strerror}", where=str(path)) from error


def environment(
    endpoints: Sequence[str],
    flavour: Flavour,
    *,
    config: Mapping[str, Any] | None = None,
    file: Path | None = None,
) -> dict[str, str]:
    """Return the variables that a component needs.

    Args:
        endpoints: Endpoints to which it connects; see `reachable`.
        flavour: Kind of program that reads the variables.
        config: Further keys of the component's Zenoh configuration.
        file: For `zenoh`: where `session_file` was written; its name ends with `.json5` or `.json`.

    Raises:
        ConfigError: The flavour needs a file, and none of a kind that Zenoh reads is given.
    """
    if flavour == "rmw_zenoh":
        text = override(client_settings(endpoints, config))
        return {"RMW_IMPLEMENTATION": "rmw_zenoh_cpp", "ZENOH_CONFIG_OVERRIDE": text}
    if file is None or file.suffix not in (".json5", ".json"):
        raise ConfigError(f"Zenoh does not read {file} as JSON", hint="choose a name such as zenoh-unit.json5")
    return {"ZENOH_CONFIG": str(file.absolute())}


def environment_lines(segment: str, endpoints: Sequence[str], flavour: Flavour, **more: Any) -> list[str]:
    """Return lines for a POSIX shell, to be run by `eval`.

    Args:
        segment: Name of the segment, for the comment.
        endpoints: Endpoints, as for `environment`.
        flavour: Kind of program that reads the variables.
        more: Further arguments of `environment`.
    """
    variables = environment(endpoints, flavour, **more)
    reader = "ROS 2 nodes" if flavour == "rmw_zenoh" else "programs that call Config::from_env"
    return [
        f"# segment {segment}, for {reader}",
        *(f"export {name}={shlex.quote(value)}" for name, value in variables.items()),
    ]
