"""The command line of `riot router`, turned into what a service needs: settings, interceptors, plan and types."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.config.arguments import parse_types
from riot_bus.config.endpoints import split_endpoints
from riot_bus.config.router_settings import DEFAULT_SEGMENTS, SEGMENT_NAME, RouterSettings, SegmentSettings, router_keys
from riot_bus.config.toml_file import MistakeError, explained, read_toml
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.zenoh.config_files import check_certificates, endpoint_files, settings_of_text, with_files

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from riot_bus.control.router_flags import RouterOptions
    from riot_bus.inject.injection_plan import InjectionPlan
    from riot_bus.types.registry import TypeRegistry

DEFAULT_SYSTEM = Path("riot.toml")


def settings_of(options: RouterOptions) -> RouterSettings:
    """Return the settings of riot.toml, as far as options do not replace them.

    Raises:
        ConfigError: The file or an option is wrong.
    """
    path = _system_file(options)
    return merged(RouterSettings() if path is None else load_router(path), options)


def _system_file(options: RouterOptions) -> Path | None:
    """Return the file that `--system` names, else riot.toml if it exists."""
    return options.system or (DEFAULT_SYSTEM if DEFAULT_SYSTEM.is_file() else None)


def intercepts(settings: RouterSettings, options: RouterOptions) -> bool:
    """Return whether something is intercepted from the beginning."""
    wanted = (settings.intercept, settings.services, settings.interceptors, options.interceptors, options.inject)
    return any(wanted) or bool(options.carried)


def interceptors_of(settings: RouterSettings, options: RouterOptions) -> list[object]:
    """Build the interceptors of riot.toml and of the command line; files that they name are executed."""
    if not settings.interceptors and not options.interceptors:
        return []
    from riot_bus.interceptors.parsing import build_all

    file = options.system or DEFAULT_SYSTEM
    return build_all(options.interceptors, tables=settings.interceptors, file=file, seed=options.seed)


def plan_of(options: RouterOptions) -> InjectionPlan | None:
    """Read the injection plan; None if there is none."""
    if options.inject is None:
        return None
    from riot_bus.inject.injection_plan import InjectionPlan

    return InjectionPlan.read(options.inject, seed=options.seed)


def registry_of(options: RouterOptions) -> TypeRegistry:
    """Return the registry of adapters, definitions and declared types, including those of riot.toml.

    Raises:
        ConfigError: A type is unknown, or a file does not define one.
    """
    from riot_bus.types.registry import TypeRegistry, chosen_adapters, load_adapters

    path = _system_file(options)
    system: Any = {} if path is None else read_toml(path)[0].get("system", {})
    known = system if isinstance(system, dict) else {}
    types, adapters, messages = known.get("types", {}), known.get("adapters"), known.get("messages", [])
    texts = [list(types.values()) if isinstance(types, dict) else types, messages, adapters or []]
    if known is not system or not all(map(_is_texts, texts)):
        hint = "adapters and messages are lists of text, types is a table of text"
        raise ConfigError("types, adapters or messages are not usable", where=f"{path}: [system]", hint=hint)
    loaded = load_adapters(chosen_adapters(adapters))
    if options.adapters:
        replaced = {text.partition(":")[0] for text in options.adapters}
        kept = [each for each in loaded if getattr(each, "name", "") not in replaced]
        loaded = [*kept, *load_adapters(options.adapters)]
    return TypeRegistry(
        loaded,
        declared={**types, **parse_types(options.types)},
        definitions=[*((path or DEFAULT_SYSTEM).resolve().parent / name for name in messages), *options.definitions],
    )


def _is_texts(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(each, str) for each in value)


def load_router(path: Path) -> RouterSettings:
    """Read `[router]` of a riot.toml; other tables may be missing and are not looked at.

    Paths come back absolute, Zenoh keys and values are checked. Without the table everything has its default.

    Raises:
        ConfigError: Missing file, unknown key or bad value; with place and suggestion.
    """
    from pydantic import TypeAdapter, ValidationError

    document, text = read_toml(path)
    root = path.resolve().parent
    try:
        settings = TypeAdapter(RouterSettings).validate_python(document.get("router", {}))
    except ValidationError as error:
        raise explained(error, path, text, router_keys, prefix=["router"]) from None
    segments = {
        name: with_files(segment, root, path=path, text=text, name=name) for name, segment in settings.segments.items()
    }
    record = None if settings.record is None else str(root / settings.record)
    return replace(settings, segments=segments, record=record)


def parse_endpoints(texts: Sequence[str], *, where: str) -> dict[str, tuple[str, ...]]:
    """Parse `NAME=ENDPOINT[,ENDPOINT...]`; a segment that is named twice has all its endpoints.

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

    Raises:
        ConfigError: It is not of this form.
    """
    found = re.fullmatch(rf"({SEGMENT_NAME}):/?([^=:\s]+)=(.*)", text, re.DOTALL)
    if not found:
        hint = "write SEGMENT:KEY=VALUE, such as unit:transport/link/tx/lease=5000"
        raise ConfigError(f"{text!r} is not a Zenoh setting of a segment", where=where, hint=hint)
    name, key, value = found.groups()
    return name, key, value


def merged(settings: RouterSettings, options: RouterOptions, *, cwd: Path | None = None) -> RouterSettings:
    """Return what the router is to do, with at least one segment.

    Raises:
        ConfigError: An option is wrong or names an unknown segment, segments conflict, or a certificate is missing.
    """
    segments = _segments(settings, options, cwd or Path.cwd())
    changed: dict[str, Any] = {
        "name": options.name,
        "intercept": tuple(options.intercept) or None,
        "services": tuple(options.services) or None,
        "record": None if options.record is None else str((cwd or Path.cwd()) / options.record),
        "budget": options.budget,
        "control": tuple(options.control) or None,
    }
    given = {name: value for name, value in changed.items() if value is not None}
    try:
        result = replace(settings, **given, segments=segments)
    except MistakeError as error:
        raise _explained(error, given) from None
    check_certificates(result)
    return result


def _segments(settings: RouterSettings, options: RouterOptions, cwd: Path) -> dict[str, SegmentSettings]:
    listen = parse_endpoints(options.segments, where="--segment")
    segments = dict(settings.segments or ({} if listen else DEFAULT_SEGMENTS))
    for name, endpoints in listen.items():
        segments[name] = _ends(segments.get(name, SegmentSettings()), "listen", endpoints, cwd, f"--segment {name}")
    for name, endpoints in parse_endpoints(options.connect, where="--connect").items():
        _check_known(name, segments, "--connect")
        segments[name] = _ends(segments[name], "connect", endpoints, cwd, f"--connect {name}")
    for text in options.cfg:
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
