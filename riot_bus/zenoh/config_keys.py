"""Validation of keys and values of Zenoh's configuration by the installed Zenoh itself."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from riot_bus.config.router_settings import forbidden
from riot_bus.vocabulary.errors import ConfigError, did_you_mean

_PLACE = re.compile(r"\s+at /\S+\.rs:\d+.*", re.DOTALL)
_REASON = re.compile(r'msg: "(.*?)", location', re.DOTALL)
_UNKNOWN = "unknown key"
_VALUES = "values are JSON; keys and values are those of Zenoh's DEFAULT_CONFIG.json5"


def leaves(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration with every table flattened, down to the values that Zenoh takes as a whole.

    A table given to Zenoh would replace all keys below it, including those that the router needs.
    """
    return dict(pair for key, value in config.items() for pair in _leaves(key.strip("/"), value))


def check_config(config: Mapping[str, Any], *, where: str) -> None:
    """Check every key and value of a segment.

    Raises:
        ConfigError: Zenoh does not know a key or rejects a value, or riot cannot work with it.
    """
    for key, value in config.items():
        why = forbidden(key, value)
        if why is not None:
            raise ConfigError(f"{key!r} cannot be set here", where=where, hint=why)
        problem = _refusal(key, json.dumps(value))
        if problem is not None:
            raise _refused(key, json.dumps(value), problem, where)


def value_of(key: str, text: str, *, where: str) -> Any:
    """Return the value that a user wrote on a command line: JSON5, or text without quotes.

    If Zenoh accepts it as JSON5, it is JSON5, otherwise text: `true`, `[1, 2]`, `cert.pem`, and `1234` for a password.

    Raises:
        ConfigError: Zenoh does not know the key, or accepts neither form.
    """
    problem = _refusal(key, text)
    if problem is None:
        return _json5(text)
    if _refusal(key, json.dumps(text)) is None:
        return text
    raise _refused(key, text, problem, where)


def value_of_file(key: str, text: str, *, where: str) -> Any:
    """Return the value in a file: its text, or JSON5 if Zenoh accepts no text; errors do not show it.

    Raises:
        ConfigError: Zenoh does not know the key, or accepts neither form.
    """
    problem = _refusal(key, json.dumps(text))
    if problem is None:
        return text
    if _refusal(key, text) is None:
        return _json5(text)
    if _UNKNOWN in problem:
        raise _refused(key, "", problem, where)
    raise ConfigError(f"Zenoh refuses what this file holds for {key!r}", where=where, hint=_VALUES)


def _leaves(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    if not isinstance(value, dict) or not isinstance(known := _default(key), dict) or not known:
        yield key, value
        return
    for name, each in value.items():
        yield from _leaves(f"{key}/{name}", each)


@cache
def _defaults() -> dict[str, Any]:
    import zenoh

    table: dict[str, Any] = json.loads(str(zenoh.Config()))
    return table


def _default(key: str) -> Any:
    table: Any = _defaults()
    for part in key.split("/"):
        table = table.get(part) if isinstance(table, dict) else None
    return table


@cache
def _known() -> list[str]:
    return [key for name, value in _defaults().items() for key, _ in _leaves(name, value)]


def _refusal(key: str, value: str) -> str | None:
    import zenoh

    try:
        zenoh.Config().insert_json5(key, value)
    except zenoh.ZError as error:
        return str(error)
    return None


def _refused(key: str, value: str, problem: str, where: str) -> ConfigError:
    if _UNKNOWN in problem:
        return ConfigError(f"Zenoh has no key {key!r}", where=where, hint=did_you_mean(key, _known()))
    found = _REASON.search(problem)
    short = _PLACE.sub("", found.group(1) if found else problem).replace("\\n", "\n").strip().splitlines()[-1]
    return ConfigError(f"Zenoh refuses {value} for {key!r}: {short.strip(' =')}", where=where, hint=_VALUES)


def _json5(text: str) -> Any:
    import zenoh

    config = zenoh.Config()
    config.insert_json5("metadata", text)  # takes any JSON5 and gives it back as JSON
    return json.loads(config.get_json("metadata"))
