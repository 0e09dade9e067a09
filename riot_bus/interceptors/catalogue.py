"""Finds interceptors by name or file, and builds them from options."""

from __future__ import annotations

import dataclasses
import inspect
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter, ValidationError

from riot_bus.pipeline.conditions import Selective, When
from riot_bus.pipeline.loader import load_class
from riot_bus.plugin_options import REQUIRED, explained_option, instance_of, options_of
from riot_bus.plugins import INTERCEPTORS
from riot_bus.vocabulary.errors import ConfigError, did_you_mean, located

if TYPE_CHECKING:
    from collections.abc import Mapping

_CONDITIONS = {"from": "source", "to": "target"} | {
    each.name: each.name for each in dataclasses.fields(When) if each.name not in ("source", "target")
}
_WHEN: TypeAdapter[When] = TypeAdapter(When)


@dataclasses.dataclass(frozen=True, slots=True)
class Option:
    """One option of an interceptor.

    Attributes:
        type: Type as it is declared, empty if it is not.
        default: Default value as text; None if there is none, or if the option is required.
        doc: Meaning of the option, in a sentence.
        required: Whether it has to be given.
    """

    name: str
    type: str
    default: str | None = None
    doc: str = ""
    required: bool = False


@dataclasses.dataclass(frozen=True, slots=True)
class Description:
    """Description of a shipped or installed interceptor, for `riot interceptors`.

    Attributes:
        summary: First line of its docstring; the reason if it cannot be loaded.
        options: Its own options, without the conditions that all interceptors have; empty if it cannot be loaded.
    """

    name: str
    summary: str
    options: tuple[Option, ...]


def build(use: str, options: Mapping[str, Any], *, where: str | None = None, root: Path | None = None) -> object:
    """Build an interceptor, wrapped in its conditions if there are any.

    Args:
        use: Name of a shipped or installed interceptor, or `FILE.py[:NAME]`, whose code is then executed.
        options: Its own options, and conditions: select, from, to, start, end, first, last, where, probability, seed;
            `name` gives it another name.
        where: Place where it is named, for errors.
        root: Folder that relative paths start from, by default the working folder.

    Raises:
        ConfigError: There is no such interceptor or option, or a value is wrong.
    """
    place = f"{where}: {use}" if where else use
    kind = _find(use, where, root)
    declared = options_of(kind)
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
    interceptor: object = instance_of(kind, own, lambda _: place, root=root)
    try:
        with located(place):
            when = _WHEN.validate_python(conditions)
    except ValidationError as error:
        raise explained_option(error, lambda _: place) from None
    return Selective(interceptor, when, name) if conditions or name else interceptor


def names() -> list[str]:
    """Return the names of all interceptors that are shipped or installed."""
    return list(INTERCEPTORS.targets())


def describe() -> list[Description]:
    """Describe the shipped and installed interceptors; the summary of one that cannot be loaded says why."""
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
                None if default in (REQUIRED, None) else str(default),
                " ".join(docs.get(key, "").split()),
                required=default is REQUIRED,
            )
            for key, (annotation, default) in options_of(kind).items()
        )
        found.append(Description(name, text.partition("\n")[0], options))
    return found


def _find(use: str, where: str | None, root: Path | None = None) -> type:
    if use.partition(":")[0].endswith(".py"):
        return load_class(use if root is None else str(root / use))
    kind = INTERCEPTORS.load(use, where=where)
    if not inspect.isclass(kind):
        hint = "its entry point has to name a class"
        raise ConfigError(f"interceptor {use!r} is not a class", where=INTERCEPTORS.targets()[use], hint=hint)
    return kind


def interceptor_list() -> list[dict[str, Any]]:
    """Return the interceptors that are known by name, and their options, as JSON values."""
    return [dataclasses.asdict(each) for each in describe()]
