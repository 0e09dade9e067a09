"""Files that a segment's Zenoh configuration names: made absolute, and missed before Zenoh misses them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.config.endpoints import ENCRYPTED, Endpoint, parse_endpoint
from riot_bus.config.toml_file import place_of
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.config_keys import check_config, leaves

if TYPE_CHECKING:
    from riot_bus.config.router_settings import RouterSettings, SegmentSettings

__all__ = ["FILE_KEYS", "TLS", "USERS", "absolute_file", "check_certificates", "endpoint_files", "with_files"]

TLS = "transport/link/tls"
USERS = "transport/auth/usrpwd"

FILE_KEYS = frozenset(
    {
        *(f"{TLS}/{side}_{kind}" for side in ("listen", "connect") for kind in ("certificate", "private_key")),
        f"{TLS}/root_ca_certificate",
        f"{USERS}/dictionary_file",
        *(f"transport/auth/pubkey/{name}_file" for name in ("public_key", "private_key", "known_keys")),
    }
)
"""Keys whose value is the path of a file."""

_LISTENER_NEEDS = ("listen_certificate", "listen_private_key")


def with_files(segment: SegmentSettings, root: Path, *, path: Path, text: str, name: str) -> SegmentSettings:
    """Return a segment of a riot.toml with Zenoh keys checked and taken apart, and paths absolute.

    Args:
        segment: As written.
        root: Folder that relative paths start from.
        path: The riot.toml, for errors.
        text: Its text.
        name: The segment's name.

    Raises:
        ConfigError: Zenoh does not know a key or refuses its value, or a file is missing.
    """
    table = ["router", "segments", name]
    config = {}
    for key, value in segment.config.items():
        where = place_of(path, text, [*table, "config", key])
        for leaf, each in leaves({key: value}).items():
            check_config({leaf: each}, where=where)
            config[leaf] = absolute_file(leaf, each, root, where=where)
    ends = {}
    for field in ("listen", "connect"):
        where = place_of(path, text, [*table, field])
        ends[field] = tuple(endpoint_files(each, root, where=where) for each in getattr(segment, field))
    return replace(segment, config=config, **ends)


def absolute_file(key: str, value: Any, root: Path, *, where: str) -> Any:
    """Return a value with its path made absolute, if the key is one of a file.

    Raises:
        ConfigError: The file does not exist.
    """
    if key not in FILE_KEYS or not isinstance(value, str):
        return value
    return str(_existing(value, root, where=f"{where}: {key}"))


def endpoint_files(text: str, root: Path, *, where: str) -> str:
    """Return an endpoint with the paths in its config part made absolute: `tls/host:1#root_ca_certificate_file=x`.

    Raises:
        ConfigError: A file does not exist.
    """
    endpoint = parse_endpoint(text)
    parameters = endpoint.parameters
    if not any(key.endswith("_file") for key in parameters):
        return text
    for key, value in parameters.items():
        if key.endswith("_file"):
            parameters[key] = str(_existing(value, root, where=f"{where}: {key}"))
    return str(endpoint.with_parameters(parameters))


def _existing(text: str, root: Path, *, where: str) -> Path:
    path = root / Path(text).expanduser()
    if not path.is_file():
        hint = "relative paths start from the folder of riot.toml, in options from the working folder"
        raise ConfigError(f"there is no file {path}", where=where, hint=hint)
    return path.absolute()  # links stay links: certificates are renewed behind them


def check_certificates(settings: RouterSettings) -> None:
    """Check that every encrypted listener has a certificate and its key.

    Raises:
        ConfigError: One is missing.
    """
    for name, segment in settings.segments.items():
        for endpoint in segment.listeners:
            for need in _LISTENER_NEEDS if endpoint.protocol in ENCRYPTED else ():
                if not _given(need, segment.config, endpoint):
                    hint = f'set "{TLS}/{need}" in [router.segments.{name}.config], or --cfg {name}:{TLS}/{need}=FILE'
                    where = f"[router.segments.{name}]"
                    raise ConfigError(f"{endpoint} needs a {need.replace('_', ' ')}", where=where, hint=hint)


def _given(need: str, config: dict[str, Any], endpoint: Endpoint) -> bool:
    return any(key.startswith(f"{TLS}/{need}") for key in config) or any(
        key.startswith(need) for key in endpoint.parameters
    )
