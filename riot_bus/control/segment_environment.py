"""Environment variables that put a process into a segment of a running router: one small contract.

The process that opens a router exports them (`export`), and each child can then choose the segment of another process
(`segment_variables`; `riot exec` does so, and what `riot ros-test` puts into processes):

| variable | example | |
|---|---|---|
| `RIOT_ENDPOINTS` | `system=tcp/127.0.0.1:41234 unit=tcp/127.0.0.1:41235` | where components of each segment connect |
| `RIOT_ZENOH_FILES` | `/tmp/riot-x/zenoh` | folder of the files for `ZENOH_CONFIG`, `zenoh-SEGMENT.json5` |
| `RIOT_DOMAINS` | `system=41 unit=42` | the ROS domain of each segment, where bridges join DDS to them |
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from riot_bus.control.environment import client_settings, override, reachable, write_session_file
from riot_bus.control.router_options import parse_endpoints
from riot_bus.vocabulary.errors import ConfigError, did_you_mean

_ENDPOINTS, FILES, _DOMAINS = "RIOT_ENDPOINTS", "RIOT_ZENOH_FILES", "RIOT_DOMAINS"
_OVERRIDE = "ZENOH_CONFIG_OVERRIDE"
_FILE = "zenoh-{}.json5"

NOT_ISOLATED = {"RMW_TEST_FIXTURE_DISABLE_ISOLATION": "1", "DISABLE_ROS_ISOLATION": "1"}
"""Variables that keep ROS's test fixtures from using a router or domain of their own instead of the given one."""


def export(
    endpoints: Mapping[str, Sequence[str]],
    *,
    files: Path | None = None,
    domains: Mapping[str, int] | None = None,
) -> dict[str, str]:
    """Return the variables by which children of a router's process can put processes into its segments.

    Args:
        endpoints: Endpoints to which the components of each segment connect.
        files: Folder that `write_session_files` has filled; without it, `segment_variables` does not reach programs
            that call Zenoh themselves.
        domains: The ROS domain that a bridge joins to each segment.
    """
    variables = {_ENDPOINTS: shlex.join(f"{name}={','.join(found)}" for name, found in endpoints.items())}
    if files is not None:
        variables[FILES] = str(files.absolute())
    if domains:
        variables[_DOMAINS] = " ".join(f"{name}={number}" for name, number in domains.items())
    return variables


def endpoints_of(name: str, environ: Mapping[str, str]) -> tuple[str, ...]:
    """Return where components of a segment connect, from the variable of `export`.

    Raises:
        ConfigError: No router has exported such a segment, or the variable is not usable.
    """
    exported = exported_endpoints(environ)
    if name not in exported:
        hint = did_you_mean(name, exported) or "run this under a command that opens a router, such as riot ros-test"
        raise ConfigError(f"no segment {name!r}", where=_ENDPOINTS, hint=hint)
    return exported[name]


def exported_endpoints(environ: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """Return where components of each segment connect, from the variable of `export`; empty without it.

    Raises:
        ConfigError: The variable is not usable.
    """
    try:
        words = shlex.split(environ.get(_ENDPOINTS, ""))
    except ValueError as error:
        hint = "write NAME=ENDPOINT[,ENDPOINT...], separated by spaces, and close all quotation marks"
        raise ConfigError(f"cannot be parsed: {error}", where=_ENDPOINTS, hint=hint) from None
    return parse_endpoints(words, where=_ENDPOINTS)


def segment_variables(
    name: str, environ: Mapping[str, str], *, config: Mapping[str, Any] | None = None
) -> dict[str, str]:
    """Return what a component of a segment needs besides these variables, whatever its kind.

    ROS 2 nodes get rmw_zenoh's override, which keeps earlier overrides of other keys, or their domain behind a bridge;
    programs that call `Config::from_env` get `ZENOH_CONFIG`, and `riot` itself `RIOT_ENDPOINT`.

    Raises:
        ConfigError: No router has exported such a segment, or a variable is not usable.
    """
    listen = endpoints_of(name, environ)
    variables = {**NOT_ISOLATED, "RIOT_ENDPOINT": reachable(listen)[0]}
    if FILES in environ:
        variables["ZENOH_CONFIG"] = str(Path(environ[FILES]) / _FILE.format(name))
    with suppress(ConfigError):  # rmw_zenoh cannot connect to what there is; others can
        settings = client_settings(reachable(listen, flavour="rmw_zenoh"), config)
        kept = [
            pair for pair in environ.get(_OVERRIDE, "").split(";") if pair.partition("=")[0].strip() not in settings
        ]
        variables[_OVERRIDE] = ";".join([*filter(str.strip, kept), override(settings)])
    domain = _domains(environ).get(name)
    if domain is not None:
        variables["ROS_DOMAIN_ID"] = domain
    elif _OVERRIDE in variables:
        variables["RMW_IMPLEMENTATION"] = "rmw_zenoh_cpp"
    return variables


def write_session_files(
    endpoints: Mapping[str, Sequence[str]], folder: Path, *, config: Mapping[str, Any] | None = None
) -> None:
    """Write the file of each segment for `ZENOH_CONFIG`, readable by this user alone.

    Raises:
        ConfigError: A file cannot be written.
    """
    for name, found in endpoints.items():
        write_session_file(folder / _FILE.format(name), client_settings(reachable(found), config))


def _domains(environ: Mapping[str, str]) -> dict[str, str]:
    pairs = [word.partition("=") for word in environ.get(_DOMAINS, "").split()]
    for name, _, number in pairs:
        if not (number.isascii() and number.isdigit()):
            raise ConfigError(f"{number!r} is not a ROS domain", where=f"{_DOMAINS}: {name}", hint="such as unit=42")
    return {name: number for name, _, number in pairs}
