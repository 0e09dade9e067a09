"""The command line of `riot router`, turned into what a service needs: settings, interceptors, plan and types."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.config.arguments import parse_types
from riot_bus.config.router_settings import RouterSettings, router_keys
from riot_bus.config.toml_file import explained, read_toml
from riot_bus.control.router_flags import RouterFlags, merged
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.config_files import with_files

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.inject.injection_plan import InjectionPlan
    from riot_bus.types.registry import TypeRegistry

__all__ = [
    "RouterOptions",
    "interceptors_of",
    "intercepts",
    "load_router",
    "plan_of",
    "registry_of",
    "settings_of",
]

DEFAULT_SYSTEM = Path("riot.toml")


@dataclass(frozen=True, slots=True)
class RouterOptions:
    """What `riot router` was asked to do, as written on the command line.

    Attributes:
        system: riot.toml; None for the one in the working folder, if there is one.
        flags: Options that replace those in its table `[router]`.
        interceptors: Interceptors that follow those of riot.toml.
        inject: Path of an injection plan.
        types: `TOPIC=TYPE`.
        definitions: Files that define message types.
        seed: Seed of everything that is random.
        bypass_watch: Whether to look for ways around the router.
        adapters: Adapters with options, such as `mavlink:dialect=ardupilotmega`, that replace those of the same name.
        carried: Further key expressions to intercept, for a bridge in the same process.
    """

    system: Path | None = None
    flags: RouterFlags = field(default_factory=RouterFlags)
    interceptors: Sequence[str] = ()
    inject: Path | None = None
    types: Sequence[str] = ()
    definitions: Sequence[Path] = ()
    seed: int = 0
    bypass_watch: bool = True
    adapters: Sequence[str] = ()
    carried: Sequence[str] = ()


def settings_of(system: Path | None, flags: RouterFlags) -> RouterSettings:
    """Return the settings of riot.toml, as far as options do not replace them.

    Args:
        system: riot.toml; None for the one in the working folder, if there is one.
        flags: The command line.

    Raises:
        ConfigError: The file or an option is wrong.
    """
    path = system if system is not None else DEFAULT_SYSTEM
    found = load_router(path) if system is not None or path.is_file() else RouterSettings()
    return merged(found, flags)


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

    path = options.system if options.system is not None else DEFAULT_SYSTEM
    system: Any = {}
    if options.system is not None or path.is_file():
        system = read_toml(path)[0].get("system", {})
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
        definitions=[*(path.resolve().parent / name for name in messages), *options.definitions],
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
