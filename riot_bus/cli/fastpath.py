"""`riot router` without typer, which takes 0.09 s to start.

Only unambiguous command lines are handled here; all others, including wrong ones, are left to typer.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_origin


class FastOption(NamedTuple):
    """An option of `riot router`.

    Attributes:
        name: Field of `RouterOptions`, or `as_json`.
        read: Function that turns its text into a value; None if the text is not simple enough.
        many: Whether it may be repeated.
        variable: The environment variable that stands for it.
        value: Value of a switch, which has no text.
    """

    name: str
    read: Callable[[str], Any] = str
    many: bool = False
    variable: str = ""
    value: bool | None = None


def _number(text: str) -> int | None:
    return int(text) if re.fullmatch(r"[0-9]{1,18}", text) else None


def _seconds(text: str) -> float | None:
    return float(text) if re.fullmatch(r"[0-9]{1,18}(\.[0-9]{1,18})?", text) else None


def _as_json(text: str) -> bool | None:
    return {"text": False, "json": True}.get(text)


@cache
def fast_options() -> dict[str, FastOption]:
    """Return the options of `riot router` as written on its command line."""
    from riot_bus.control.router_flags import RouterOptions
    from riot_bus.vocabulary.flags import flags_of

    readers: dict[Any, Callable[[str], Any]] = {str: str, Path: Path, int: _number, float: _seconds}
    found = {"--format": FastOption("as_json", _as_json, variable="RIOT_FORMAT")}
    for field, flag, names in flags_of(RouterOptions):
        kind = get_args(field.type)[0]
        if kind is bool:
            for written, value in zip(names[0].split("/"), (True, False), strict=True):
                found[written] = FastOption(field.name, value=value)
        else:
            read = readers[(get_args(kind) or (kind,))[0]]
            option = FastOption(field.name, read, many=get_origin(kind) is Sequence, variable=flag.env or "")
            found |= dict.fromkeys(names, option)
    return found


def parse(arguments: Sequence[str], environment: Mapping[str, str]) -> dict[str, Any] | None:
    """Return the fields of `RouterOptions`, and `as_json`.

    Returns:
        None if the command line is not unambiguous.
    """
    options = fast_options()
    if any(each.variable in environment for each in options.values()):
        return None
    found: dict[str, Any] = {}
    rest = iter(arguments)
    for argument in rest:
        word, equals, text = argument.partition("=")
        option = options.get(word)
        if option is None or (equals and not word.startswith("--")) or (option.name in found and not option.many):
            return None
        if option.value is not None and not equals:
            found[option.name] = option.value
            continue
        text = text if equals else next(rest, "")
        value = None if not text or option.value is not None or text.startswith("-") else option.read(text)
        if value is None:
            return None
        if option.many:
            found.setdefault(option.name, []).append(value)
        else:
            found[option.name] = value
    return found


def quick_start(arguments: Sequence[str]) -> bool:
    """Execute a command line if it is an unambiguous `riot router`; return whether it was."""
    found = parse(arguments[1:], os.environ) if arguments[:1] == ["router"] else None
    if found is None:
        return False
    start_router(found, as_json=found.pop("as_json", False))
    return True


def start_router(given: Mapping[str, Any], *, as_json: bool) -> None:
    """Run a router until it is told to stop; takes the fields of `RouterOptions`."""
    from riot_bus.control.router_flags import RouterOptions
    from riot_bus.control.router_process import run_router
    from riot_bus.control.terminal import Foreground

    run_router(RouterOptions(**given), Foreground(say, warn, as_json=as_json))


def say(line: str) -> None:
    """Print a line of the result."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def warn(line: str) -> None:
    """Print a line of diagnostics."""
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()
