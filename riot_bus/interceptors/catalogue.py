"""Finds interceptors by name or file, and builds them from options."""

from __future__ import annotations

import dataclasses
import inspect
import re
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from pydantic import PydanticUserError, TypeAdapter, ValidationError

from riot_bus.pipeline.conditions import Selective, When
from riot_bus.pipeline.loader import load_class
from riot_bus.vocabulary.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["Description", "Option", "build", "describe", "names"]

_GROUP = "riot_bus.interceptors"
_BUILT_IN = {
    "bandwidth": "riot_bus.interceptors.losses:Bandwidth",
    "clock_offset": "riot_bus.interceptors.payloads:ClockOffset",
    "corrupt": "riot_bus.interceptors.payloads:Corrupt",
    "delay": "riot_bus.interceptors.timing:Delay",
    "drop": "riot_bus.interceptors.losses:Drop",
    "duplicate": "riot_bus.interceptors.copies:Duplicate",
    "freeze": "riot_bus.interceptors.payloads:Freeze",
    "inject": "riot_bus.interceptors.plan:Inject",
    "jitter": "riot_bus.interceptors.timing:Jitter",
    "record": "riot_bus.interceptors.record:Record",
    "reorder": "riot_bus.interceptors.timing:Reorder",
    "set": "riot_bus.interceptors.payloads:SetField",
    "tee": "riot_bus.interceptors.copies:Tee",
    "throttle": "riot_bus.interceptors.losses:Throttle",
    "truncate": "riot_bus.interceptors.payloads:Truncate",
}
_CONDITIONS = {"from": "source", "to": "target"} | {
    each.name: each.name for each in dataclasses.fields(When) if each.name not in ("source", "target")
}
_REQUIRED = dataclasses.MISSING
_WHEN: TypeAdapter[When] = TypeAdapter(When)


@dataclasses.dataclass(frozen=True, slots=True)
class Option:
    """One option of an interceptor.

    Attributes:
        name: As it is written.
        type: As it is declared, empty if it is not.
        default: None also if it is required.
        doc: What it means.
        required: Whether it has to be given.
    """

    name: str
    type: str
    default: Any = None
    doc: str = ""
    required: bool = False


@dataclasses.dataclass(frozen=True, slots=True)
class Description:
    """An interceptor that can be named."""

    name: str
    summary: str
    options: tuple[Option, ...]


def build(use: str, options: Mapping[str, Any], *, where: str | None = None, root: Path | None = None) -> object:
    """Build an interceptor.

    Args:
        use: Name of a shipped or installed interceptor, or `FILE.py[:NAME]`, whose code is then executed.
        options: Its own options, and conditions: select, from, to, start, end, first, last, where, probability, seed;
            `name` gives it another name.
        where: Place of the text that it was named in, for errors.
        root: Folder that relative paths start from, by default the working folder.

    Returns:
        The interceptor, wrapped in its conditions if there are any.

    Raises:
        ConfigError: There is no such interceptor or option, or a value is wrong.
    """
    place = f"{where}: {use}" if where else use
    kind = _find(use, where, root)
    declared = _options(kind)
    conditions, own, name = {}, {}, None
    for key, value in options.items():
        if key in _CONDITIONS and (key == "seed" or key not in declared):
            conditions[_CONDITIONS[key]] = tuple(value) if isinstance(value, list) else value
        if key in declared:
            own[key] = value
        elif key == "name":
            name = str(value)
        elif key not in _CONDITIONS:
            raise ConfigError(f"unknown option {key!r}", where=place, hint=did_you_mean(key, {*declared, *_CONDITIONS}))
    interceptor = _instance(kind, own, declared, place, root)
    try:
        when = _WHEN.validate_python(conditions)
    except ValidationError as error:
        raise _explained(error, place) from None
    except ConfigError as error:
        raise ConfigError(error.message, where=place, hint=error.hint) from None
    return Selective(interceptor, when, name) if conditions or name else interceptor


def names() -> list[str]:
    """Return the names of all interceptors that are shipped or installed."""
    return sorted(_targets())


def describe() -> list[Description]:
    """Return what is shipped and installed, by name; of what cannot be loaded, why."""
    found = []
    for name in names():
        try:
            kind = _find(name, None)
        except ConfigError as error:
            found.append(Description(name, error.message, ()))
            continue
        text = inspect.getdoc(kind) or ""
        docs = dict(re.findall(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", text, re.MULTILINE))
        options = tuple(
            Option(
                key,
                annotation,
                None if default is _REQUIRED else default,
                " ".join(docs.get(key, "").split()),
                required=default is _REQUIRED,
            )
            for key, (annotation, default) in _options(kind).items()
        )
        found.append(Description(name, text.partition("\n")[0], options))
    return found


def _targets() -> dict[str, str]:
    return _BUILT_IN | {point.name: point.value for point in entry_points(group=_GROUP)}


def _find(use: str, where: str | None, root: Path | None = None) -> type:
    if use.partition(":")[0].endswith(".py"):
        return load_class(use if root is None else str(root / use))
    targets = _targets()
    if use not in targets:
        hint = did_you_mean(use, targets) or "name a shipped one, or write FILE.py[:NAME]"
        raise ConfigError(f"no interceptor {use!r}", where=where, hint=hint)
    module, _, attribute = targets[use].partition(":")
    try:
        kind = getattr(import_module(module), attribute)
    except Exception as error:  # somebody else's package
        hint = "mend or uninstall the package"
        raise ConfigError(f"interceptor {use!r} cannot be loaded: {error}", where=targets[use], hint=hint) from error
    if not inspect.isclass(kind):
        raise ConfigError(f"interceptor {use!r} is not a class", where=targets[use])
    return kind


def _options(kind: type) -> dict[str, tuple[str, Any]]:
    """Return type and default of each option that a class declares; the default is `_REQUIRED` if there is none."""
    if dataclasses.is_dataclass(kind):
        return {each.name: (_spelt(each.type), _default(each)) for each in dataclasses.fields(kind) if each.init}
    if not any("__init__" in vars(each) for each in kind.__mro__[:-1]):
        return {}
    parameters = list(inspect.signature(kind).parameters.values())
    return {
        each.name: (
            "" if each.annotation is each.empty else _spelt(each.annotation),
            _REQUIRED if each.default is each.empty else each.default,
        )
        for each in parameters
        if each.kind in (each.POSITIONAL_OR_KEYWORD, each.KEYWORD_ONLY)
    }


def _spelt(annotation: Any) -> str:
    return annotation.__name__ if inspect.isclass(annotation) else str(annotation)


def _default(option: dataclasses.Field[Any]) -> Any:
    if option.default_factory is not dataclasses.MISSING:
        return option.default_factory()
    return _REQUIRED if option.default is dataclasses.MISSING else option.default


def _instance(kind: type, own: dict[str, Any], declared: Mapping[str, Any], place: str, root: Path | None) -> object:
    try:
        hints = get_type_hints(kind if dataclasses.is_dataclass(kind) else vars(kind).get("__init__", kind))
    except Exception:  # a file's own annotations may name what is not imported
        hints = {}
    try:
        made: object = kind(**{key: _validated(key, value, hints, place, root) for key, value in own.items()})
    except ConfigError as error:
        raise ConfigError(error.message, where=place, hint=error.hint) from None
    except TypeError as error:
        hint = f"its options: {', '.join(declared)}" if declared else "it takes no options"
        raise ConfigError(str(error), where=place, hint=hint) from error
    except Exception as error:
        raise ConfigError(f"{kind.__name__} raised {error!r}", where=place) from error
    return made


def _validated(key: str, value: Any, hints: Mapping[str, Any], place: str, root: Path | None) -> Any:
    if key not in hints:
        return value
    try:
        validated = TypeAdapter(hints[key]).validate_python(value)
    except ValidationError as error:
        raise _explained(error, place, key) from None
    except PydanticUserError:  # a type that is only known to its author
        return value
    return root / validated if root is not None and isinstance(validated, Path) else validated


def _explained(error: ValidationError, place: str, option: str = "") -> ConfigError:
    problem = error.errors()[0]
    option = option or (str(problem["loc"][0]) if problem["loc"] else "")
    text = problem["msg"].removeprefix("Value error, ")
    got = f" (got {problem['input']!r})" if option else ""
    return ConfigError(f"{option}: {text}{got}" if option else text, where=place)
