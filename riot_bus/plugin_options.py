"""Options of plug-in classes: their declarations, and instances made from what users wrote."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from pydantic import PydanticUserError, TypeAdapter, ValidationError

from riot_bus.vocabulary.errors import ConfigError, did_you_mean

PluginT = TypeVar("PluginT")

REQUIRED = dataclasses.MISSING
"""Default of an option that has to be given."""


def options_of(kind: type) -> dict[str, tuple[str, Any]]:
    """Return declared type (empty if undeclared) and default of each option of a class; see `REQUIRED`."""
    if dataclasses.is_dataclass(kind):
        return {each.name: (_spelt(each.type), _default(each)) for each in dataclasses.fields(kind) if each.init}
    if not any("__init__" in vars(each) for each in kind.__mro__[:-1]):
        return {}
    parameters = list(inspect.signature(kind).parameters.values())
    return {
        each.name: (
            "" if each.annotation is each.empty else _spelt(each.annotation),
            REQUIRED if each.default is each.empty else each.default,
        )
        for each in parameters
        if each.kind in (each.POSITIONAL_OR_KEYWORD, each.KEYWORD_ONLY)
    }


def check_known(values: Mapping[str, Any], known: Mapping[str, Any], where: Callable[[str], str]) -> None:
    """Raise ConfigError at the first option that is not known."""
    for key in values:
        if key not in known:
            raise ConfigError(f"unknown option {key!r}", where=where(key), hint=did_you_mean(key, known))


def instance_of(
    kind: type[PluginT], values: Mapping[str, Any], where: Callable[[str], str], *, root: Path | None = None
) -> PluginT:
    """Make an instance, with each option checked against the type that the class declares.

    All options exist in the class. `where` returns the place of an option; for an empty name, that of all. Relative
    paths start from `root`, None for the working folder.

    Raises:
        ConfigError: A value is wrong, an option is missing, or the class refuses them.
    """
    try:
        hints = get_type_hints(
            kind if dataclasses.is_dataclass(kind) else vars(kind).get("__init__", kind), include_extras=True
        )
    except Exception:  # annotations in a user's file may use names that are not imported
        hints = {}
    declared = options_of(kind)
    for name, (_, default) in declared.items():
        if default is REQUIRED and name not in values:
            raise ConfigError(f"option {name!r} is missing", where=where(""), hint=_all(declared))
    try:
        return kind(**{key: _validated(key, value, hints, where, root) for key, value in values.items()})
    except ConfigError as error:
        raise ConfigError(error.message, where=error.where or where(""), hint=error.hint) from None
    except TypeError as error:
        raise ConfigError(str(error), where=where(""), hint=_all(declared)) from error
    except Exception as error:
        raise ConfigError(f"{kind.__name__} raised {error!r}", where=where("")) from error


def explained_option(error: ValidationError, where: Callable[[str], str], option: str = "") -> ConfigError:
    """Return pydantic's error about one option as a ConfigError with place and value."""
    problem = error.errors()[0]
    option = option or (str(problem["loc"][0]) if problem["loc"] else "")
    text = problem["msg"].removeprefix("Value error, ")
    got = f" (got {problem['input']!r})" if option else ""
    return ConfigError(f"{option}: {text}{got}" if option else text, where=where(option))


def _all(declared: Mapping[str, Any]) -> str:
    return f"its options: {', '.join(declared)}" if declared else "it takes no options"


def _spelt(annotation: Any) -> str:
    return annotation.__name__ if inspect.isclass(annotation) else str(annotation)


def _default(option: dataclasses.Field[Any]) -> Any:
    if option.default_factory is not dataclasses.MISSING:
        return option.default_factory()
    return REQUIRED if option.default is dataclasses.MISSING else option.default


def _validated(key: str, value: Any, hints: Mapping[str, Any], where: Callable[[str], str], root: Path | None) -> Any:
    if key not in hints:
        return value
    try:
        validated = TypeAdapter(hints[key]).validate_python(value)
    except ValidationError as error:
        raise explained_option(error, where, key) from None
    except PydanticUserError:  # a custom type that pydantic does not know
        return value
    return root / validated if root is not None and isinstance(validated, Path) else validated
