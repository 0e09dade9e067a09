"""Options of `riot router`, merged with riot.toml: an option wins over the file, the file over defaults."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.config.endpoints import split_endpoints
from riot_bus.config.router_settings import DEFAULT_SEGMENTS, RouterSettings, SegmentSettings
from riot_bus.config.setting_checks import SEGMENT_NAME
from riot_bus.config.toml_file import MistakeError
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.zenoh.config_files import check_certificates, endpoint_files, settings_of_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

__all__ = ["RouterFlags", "merged", "parse_cfg", "parse_endpoints"]


@dataclass(frozen=True, slots=True)
class RouterFlags:
    """Options given on the command line; None or empty if not given."""

    segments: Sequence[str] = ()
    connect: Sequence[str] = ()
    cfg: Sequence[str] = ()
    name: str | None = None
    intercept: Sequence[str] = ()
    services: Sequence[str] = ()
    record: Path | None = None
    budget: float | None = None
    control: Sequence[str] = ()


def parse_endpoints(texts: Sequence[str], *, where: str) -> dict[str, tuple[str, ...]]:
    """Parse `NAME=ENDPOINT[,ENDPOINT...]`; a segment that is named twice has all its endpoints.

    Args:
        texts: The options as the user wrote them.
        where: The option, for errors.

    Raises:
        ConfigError: A text is not of this form; whether the endpoints can work is checked later.
    """
    segments: dict[str, tuple[str, ...]] = {}
    for text in texts:
        name, _, rest = text.partition("=")
        endpoints = split_endpoints(rest)
        if not re.fullmatch(SEGMENT_NAME, name) or not endpoints:
            hint = "write NAME=ENDPOINT[,ENDPOINT...], such as unit=tcp/127.0.0.1:7448"
            raise ConfigError(f"{text!r} is not a segment and its endpoints", where=where, hint=hint)
        segments[name] = (*segments.get(name, ()), *endpoints)
    return segments


def parse_cfg(text: str, where: str = "--cfg") -> tuple[str, str, str]:
    """Parse `SEGMENT:KEY=VALUE` into segment, key and the text of the value.

    Args:
        text: The option as the user wrote it.
        where: The option, for errors.

    Raises:
        ConfigError: It is not of this form.
    """
    found = re.fullmatch(rf"({SEGMENT_NAME}):/?([^=:\s]+)=(.*)", text, re.DOTALL)
    if not found:
        hint = "write SEGMENT:KEY=VALUE, such as unit:transport/link/tx/lease=5000"
        raise ConfigError(f"{text!r} is not a Zenoh setting of a segment", where=where, hint=hint)
    name, key, value = found.groups()
    return name, key, value


def merged(settings: RouterSettings, flags: RouterFlags, *, cwd: Path | None = None) -> RouterSettings:
    """Return what the router is to do, with at least one segment.

    `--segment` and `--connect` replace the endpoints that riot.toml gives this segment, `--cfg` one key.

    Args:
        settings: As `load_router` returns them, or `RouterSettings()`.
        flags: The command line.
        cwd: Where relative paths in options start from, by default the working folder.

    Raises:
        ConfigError: An option is wrong or names an unknown segment, segments conflict, or a certificate is missing.
    """
    segments = _segments(settings, flags, cwd or Path.cwd())
    changed: dict[str, Any] = {
        "name": flags.name,
        "intercept": tuple(flags.intercept) or None,
        "services": tuple(flags.services) or None,
        "record": None if flags.record is None else str((cwd or Path.cwd()) / flags.record),
        "budget": flags.budget,
        "control": tuple(flags.control) or None,
    }
    given = {name: value for name, value in changed.items() if value is not None}
    try:
        result = replace(settings, **given, segments=segments)
    except MistakeError as error:
        raise _explained(error, given) from None
    check_certificates(result)
    return result


def _segments(settings: RouterSettings, flags: RouterFlags, cwd: Path) -> dict[str, SegmentSettings]:
    listen = parse_endpoints(flags.segments, where="--segment")
    segments = dict(settings.segments or ({} if listen else DEFAULT_SEGMENTS))
    for name, endpoints in listen.items():
        segments[name] = _ends(segments.get(name, SegmentSettings()), "listen", endpoints, cwd, f"--segment {name}")
    for name, endpoints in parse_endpoints(flags.connect, where="--connect").items():
        _check_known(name, segments, "--connect")
        segments[name] = _ends(segments[name], "connect", endpoints, cwd, f"--connect {name}")
    for text in flags.cfg:
        name, key, value = parse_cfg(text)
        _check_known(name, segments, "--cfg")
        where = f"--cfg {name}"
        config = settings_of_text(key, value, cwd, where=where)
        segments[name] = _changed(segments[name], "config", {**segments[name].config, **config}, where)
    return segments


def _ends(segment: SegmentSettings, field: str, texts: Sequence[str], cwd: Path, where: str) -> SegmentSettings:
    checked = _changed(segment, field, texts, where)
    return _changed(checked, field, [endpoint_files(text, cwd, where=where) for text in texts], where)


def _changed(segment: SegmentSettings, field: str, value: Any, where: str) -> SegmentSettings:
    try:
        return replace(segment, **{field: value})
    except MistakeError as error:
        raise ConfigError(error.message, where=where, hint=error.hint) from None


def _check_known(name: str, segments: Iterable[str], where: str) -> None:
    if name not in segments:
        raise ConfigError(f"no segment {name!r}", where=where, hint=did_you_mean(name, segments))


def _explained(error: MistakeError, given: Mapping[str, Any]) -> ConfigError:
    place = error.place
    where = f"--{place[0]}" if place[0] in given else f"[{'.'.join(['router', *place[:-1]])}]"
    return ConfigError(error.message, where=where, hint=error.hint)
