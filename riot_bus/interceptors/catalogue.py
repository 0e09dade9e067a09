"""Finds interceptors by name or file, and builds them from options."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from riot_bus.pipeline.conditions import Selective, When
from riot_bus.pipeline.loader import load_class
from riot_bus.plugin_options import REQUIRED, explained_option, instance_of, options_of
from riot_bus.plugins import INTERCEPTORS
from riot_bus.vocabulary.errors import ConfigError, did_you_mean, located

_CONDITIONS = {"from": "source", "to": "target"} | {
    each.name: each.name for each in dataclasses.fields(When) if each.name not in ("source", "target")
}
_WHEN: TypeAdapter[When] = TypeAdapter(When)


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


def interceptor_list() -> list[dict[str, Any]]:
    """Describe the shipped and installed interceptors as JSON values, without the conditions that all have.

    A default is a text, None if there is none. The summary of one that cannot be loaded says why.
    """
    return [_described(name) for name in INTERCEPTORS.targets()]


def _described(name: str) -> dict[str, Any]:
    try:
        kind = _find(name, None)
    except ConfigError as error:
        return {"name": name, "summary": error.message, "options": ()}
    text = inspect.getdoc(kind) or ""
    docs = dict(re.findall(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", text, re.MULTILINE))
    options = tuple(
        {
            "name": key,
            "type": annotation,
            "default": None if default in (REQUIRED, None) else str(default),
            "doc": " ".join(docs.get(key, "").split()),
            "required": default is REQUIRED,
        }
        for key, (annotation, default) in options_of(kind).items()
    )
    return {"name": name, "summary": text.partition("\n")[0], "options": options}


def _find(use: str, where: str | None, root: Path | None = None) -> type:
    if use.partition(":")[0].endswith(".py"):
        return load_class(use if root is None else str(root / use))
    kind = INTERCEPTORS.load(use, where=where)
    if not inspect.isclass(kind):
        hint = "its entry point has to name a class"
        raise ConfigError(f"interceptor {use!r} is not a class", where=INTERCEPTORS.targets()[use], hint=hint)
    return kind
