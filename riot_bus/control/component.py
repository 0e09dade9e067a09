"""What a component is given so that it uses a segment: `riot router env`, and options of clients."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.control.environment import (
    client_settings,
    environment_lines,
    missing_for_clients,
    reachable,
    write_session_file,
)
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.config_files import settings_of_text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from riot_bus.control.environment import Flavour
    from riot_bus.control.router_flags import RouterOptions


def client_cfg(texts: Sequence[str], *, cwd: Path | None = None, where: str = "--cfg") -> dict[str, Any]:
    """Parse `KEY=VALUE`, settings of a client's Zenoh configuration.

    Raises:
        ConfigError: A text is not of this form, Zenoh refuses it, or a file is missing or readable by others.
    """
    config: dict[str, Any] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not key or not equals:
            hint = "write KEY=VALUE, such as transport/link/tls/root_ca_certificate=ca.pem"
            raise ConfigError(f"{text!r} is not a Zenoh setting", where=where, hint=hint)
        config |= settings_of_text(key.strip("/"), value, cwd or Path.cwd(), where=where)
    return config


def segment_access(
    segment: str,
    options: RouterOptions,
    config: Mapping[str, Any],
    *,
    flavour: Flavour = "zenoh",
    host: str | None = None,
) -> tuple[list[str], dict[str, Any], list[str]]:
    """Return where a component connects to a segment, its Zenoh configuration, and hints for what is still missing.

    Raises:
        ConfigError: There is no such segment, or it cannot be reached.
    """
    from riot_bus.control.router_options import settings_of

    found = settings_of(options).segment(segment)
    return reachable(found.listen, flavour=flavour, host=host), *missing_for_clients(found, config)


def component_environment(
    segment: str,
    flavour: Flavour,
    options: RouterOptions,
    *,
    host: str | None = None,
    cfg: Sequence[str] = (),
    file: Path | None = None,
) -> tuple[list[str], list[str]]:
    """Return lines for a shell by which a component uses a segment, and hints for what is still missing.

    For `zenoh` the configuration file is written, readable by its owner alone, since it may hold a password.

    Raises:
        ConfigError: There is no such segment, or it cannot be reached.
    """
    endpoints, config, hints = segment_access(segment, options, client_cfg(cfg), flavour=flavour, host=host)
    if flavour != "zenoh":
        return environment_lines(segment, endpoints, flavour, config=config), hints
    file = file or Path(f"zenoh-{segment}.json5")
    lines = environment_lines(segment, endpoints, flavour, file=file)
    write_session_file(file, client_settings(endpoints, config))
    return lines, hints
