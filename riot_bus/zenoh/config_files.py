"""Files that a segment's Zenoh configuration names: made absolute, and missed before Zenoh misses them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.config.endpoints import ENCRYPTED, Endpoint, parse_endpoint
from riot_bus.config.toml_file import place_of
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.config_keys import check_config, leaves, value_of

if TYPE_CHECKING:
    from riot_bus.config.router_settings import RouterSettings, SegmentSettings

__all__ = [
    "FILE_KEYS",
    "TLS",
    "USERS",
    "absolute_file",
    "cfg_value",
    "check_certificates",
    "check_private",
    "endpoint_files",
    "read_secret",
    "with_files",
]

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

_PRIVATE_KEYS = frozenset(key for key in FILE_KEYS if "private_key" in key or key.endswith("dictionary_file"))
_LONGEST_SECRET = 1 << 16

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


def read_secret(text: str, root: Path, *, where: str) -> str:
    """Return the text of a file that holds a secret, without its last line feed.

    Args:
        text: Its path, as written.
        root: Folder that relative paths start from.
        where: Place for errors.

    Raises:
        ConfigError: It does not exist, is too long or no text, or others may read it.
    """
    path = _existing(text, root, where=where)
    check_private(path, where=where)
    try:
        with path.open(encoding="utf-8") as file:
            found = file.read(_LONGEST_SECRET + 1)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read {path}: {error}", where=where) from None
    if len(found) > _LONGEST_SECRET:
        raise ConfigError(f"{path} is longer than {_LONGEST_SECRET} letters", where=where, hint="is it the right file?")
    return found.removesuffix("\n")


def cfg_value(key: str, text: str, root: Path, *, where: str) -> Any:
    """Return a value of `--cfg KEY=VALUE`: JSON5, or text, or the text of a file that `@FILE` names.

    Raises:
        ConfigError: Zenoh does not know the key or refuses the value, or the file cannot be used.
    """
    if not text.startswith("@"):
        return value_of(key, text, where=where)
    return value_of(key, json.dumps(read_secret(text[1:], root, where=f"{where}: {key}")), where=where)


def check_private(path: Path, *, where: str) -> None:
    """Raise ConfigError if others than its owner may read a file."""
    mode = path.stat().st_mode & 0o777
    if mode & 0o077:
        hint = f"chmod 600 {path}"
        raise ConfigError(f"others may read the secrets in {path} (mode {mode:03o})", where=where, hint=hint)


def absolute_file(key: str, value: Any, root: Path, *, where: str) -> Any:
    """Return a value with its path made absolute, if the key is one of a file.

    Raises:
        ConfigError: The file does not exist, or it holds secrets that others may read.
    """
    if key not in FILE_KEYS or not isinstance(value, str):
        return value
    path = _existing(value, root, where=f"{where}: {key}")
    if key in _PRIVATE_KEYS:
        check_private(path, where=f"{where}: {key}")
    return str(path)


def endpoint_files(text: str, root: Path, *, where: str) -> str:
    """Return an endpoint with the paths in its config part made absolute: `tls/host:1#root_ca_certificate_file=x`.

    Raises:
        ConfigError: A file does not exist, or it holds secrets that others may read.
    """
    endpoint = parse_endpoint(text)
    parameters = endpoint.parameters
    if not any(key.endswith("_file") for key in parameters):
        return text
    for key, value in parameters.items():
        if key.endswith("_file"):
            path = _existing(value, root, where=f"{where}: {key}")
            if "private_key" in key:
                check_private(path, where=f"{where}: {key}")
            parameters[key] = str(path)
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
