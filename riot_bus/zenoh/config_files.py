"""Files named in a Zenoh configuration: paths are made absolute, and missing files and exposed secrets are errors."""

from __future__ import annotations

import os
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from riot_bus.config.endpoints import ENCRYPTED, Endpoint, parse_endpoint
from riot_bus.config.router_settings import RouterSettings, SegmentSettings
from riot_bus.config.toml_file import place_of
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.redaction import redacted
from riot_bus.zenoh.config_keys import check_config, leaves, value_of, value_of_file

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

_LARGEST_SECRET = 64 << 10  # passwords, keys and certificates have some KiB; anything else is a mistake
_LISTENER_NEEDS = ("listen_certificate", "listen_private_key")


def with_files(segment: SegmentSettings, root: Path, *, path: Path, text: str, name: str) -> SegmentSettings:
    """Return a segment of a riot.toml with Zenoh keys checked and flattened, and with absolute paths.

    Raises:
        ConfigError: Zenoh does not know a key or rejects its value, or a file is missing.
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


def settings_of_text(key: str, text: str, root: Path, *, where: str) -> dict[str, Any]:
    """Return the settings of `KEY=TEXT` on a command line, with `@FILE` replaced by its contents, and absolute paths.

    Raises:
        ConfigError: Zenoh does not know the key or rejects its value, a file is missing or readable by others, or a
            secret is on the command line.
    """
    if not text.startswith("@"):
        value = value_of(key, text, where=where)
        for leaf in leaves({key: value}):
            _check_unseen(leaf, f"{key}={text}", where=where)
    elif key in FILE_KEYS:
        raise ConfigError(f"{key} is the path of a file", where=where, hint="leave the @ out")
    else:
        path = _existing(text[1:], root, where=f"{where}: {key}", secret=True)
        value = value_of_file(key, _held(path, where=f"{where}: {key}"), where=f"{where}: {path}")
    return {leaf: absolute_file(leaf, each, root, where=where) for leaf, each in leaves({key: value}).items()}


def _held(path: Path, *, where: str) -> str:
    try:
        with path.open("rb") as stream:
            data = stream.read(_LARGEST_SECRET + 1)
        if len(data) > _LARGEST_SECRET:
            raise ConfigError(f"{path} is larger than 64 KiB", where=where, hint="is it the right file?")
        return data.decode().removesuffix("\n").removesuffix("\r")
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}", where=where) from error
    except UnicodeDecodeError:
        raise ConfigError(f"{path} is not text in UTF-8", where=where, hint="is it the right file?") from None


def absolute_file(key: str, value: Any, root: Path, *, where: str) -> Any:
    """Return a value with its path made absolute, if the key is one of a file.

    Raises:
        ConfigError: The file does not exist, or holds a secret and may be read by others.
    """
    if key not in FILE_KEYS or not isinstance(value, str):
        return value
    return str(_existing(value, root, where=f"{where}: {key}", secret=_is_secret(key)))


def endpoint_files(text: str, root: Path, *, where: str) -> str:
    """Return an endpoint with the paths in its config part made absolute: `tls/host:1#root_ca_certificate_file=x`.

    Raises:
        ConfigError: A file does not exist, or holds a secret and may be read by others, or a secret is on the command
            line.
    """
    endpoint = parse_endpoint(text)
    parameters = endpoint.parameters
    for key, value in parameters.items():
        _check_unseen(key, f"{key}={value}", where=where)
    if not any(key.endswith("_file") for key in parameters):
        return text
    for key, value in parameters.items():
        if key.endswith("_file"):
            parameters[key] = str(_existing(value, root, where=f"{where}: {key}", secret=_is_secret(key)))
    return str(endpoint.with_parameters(parameters))


def _check_unseen(key: str, written: str, *, where: str) -> None:
    """Refuse a secret that was written on this program's command line; from the environment, it may be as it is."""
    if redacted(f"{key}=.") != f"{key}=." and any(written in word for word in sys.argv):
        hint = "name a file that holds it (docs/router.md#secrets), or set the option's environment variable"
        raise ConfigError(f"{key} is a secret, and all users of a machine see command lines", where=where, hint=hint)


def _is_secret(key: str) -> bool:
    return "private_key" in key or key.endswith("dictionary_file")


def _existing(text: str, root: Path, *, where: str, secret: bool) -> Path:
    path = root / Path(text).expanduser()
    if not path.is_file():
        hint = "relative paths start from the folder of riot.toml, in options from the working folder"
        raise ConfigError(f"there is no file {path}", where=where, hint=hint)
    if secret:
        _check_private(path, where=where)
    return path.absolute()  # symbolic links are kept, since renewed certificates change their targets


def _check_private(path: Path, *, where: str) -> None:
    mode = path.stat().st_mode & 0o777
    if os.name != "posix" or not mode & 0o077 or _is_credential(path):
        return
    hint = f"chmod 600 {shlex.quote(str(path))}"
    raise ConfigError(f"others may read {path} (mode {mode:04o}), which holds a secret", where=where, hint=hint)


def _is_credential(path: Path) -> bool:
    """Return whether it is a systemd credential (`LoadCredential=`) only for this service; its mode shows an ACL."""
    folder = os.environ.get("CREDENTIALS_DIRECTORY")
    return folder is not None and path.resolve().is_relative_to(Path(folder).resolve())


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
