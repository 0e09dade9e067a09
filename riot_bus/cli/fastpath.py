"""`riot router` without typer, which takes longer to start than the router itself.

Only unambiguous command lines are handled here; all others, including wrong ones, are left to typer. The options are
declared in `riot_bus.cli.router`; a test checks this table against it.
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

__all__ = ["OPTIONS", "FastOption", "parse", "quick_start", "say", "start_router", "warn"]

_WHOLE = r"[0-9]{1,18}"
_DECIMAL = r"[0-9]{1,18}(\.[0-9]{1,18})?"


class FastOption(NamedTuple):
    """An option of `riot router`.

    Attributes:
        name: Name of the argument of `start_router`.
        read: Function that turns its text into a value; None if the text is not simple enough.
        many: Whether it may be repeated.
        variable: The environment variable that stands for it.
    """

    name: str
    read: Callable[[str], Any]
    many: bool = False
    variable: str = ""


def _number(text: str) -> int | None:
    return int(text) if re.fullmatch(_WHOLE, text) else None


def _seconds(text: str) -> float | None:
    return float(text) if re.fullmatch(_DECIMAL, text) else None


def _as_json(text: str) -> bool | None:
    return {"text": False, "json": True}.get(text)


OPTIONS = {
    "--system": FastOption("system", Path, variable="RIOT_SYSTEM"),
    "-s": FastOption("system", Path, variable="RIOT_SYSTEM"),
    "--segment": FastOption("segment", str, many=True, variable="RIOT_SEGMENT"),
    "--connect": FastOption("connect", str, many=True, variable="RIOT_CONNECT"),
    "--cfg": FastOption("cfg", str, many=True, variable="RIOT_CFG"),
    "--name": FastOption("name", str, variable="RIOT_NAME"),
    "--intercept": FastOption("intercept", str, many=True, variable="RIOT_INTERCEPT"),
    "--intercept-services": FastOption("intercept_services", str, many=True, variable="RIOT_INTERCEPT_SERVICES"),
    "--interceptor": FastOption("interceptor", str, many=True),
    "--inject": FastOption("inject", Path, variable="RIOT_INJECT"),
    "--record": FastOption("record", Path, variable="RIOT_RECORD"),
    "--type": FastOption("type_", str, many=True),
    "--msg": FastOption("msg", Path, many=True),
    "--seed": FastOption("seed", _number, variable="RIOT_SEED"),
    "--budget": FastOption("budget", _seconds, variable="RIOT_BUDGET"),
    "--control": FastOption("control", str, many=True, variable="RIOT_CONTROL"),
    "--format": FastOption("as_json", _as_json, variable="RIOT_FORMAT"),
}
"""Options that have a value, as written on the command line."""

_SWITCHES = {"--bypass-watch": True, "--no-bypass-watch": False}


def parse(arguments: Sequence[str], environment: Mapping[str, str]) -> dict[str, Any] | None:
    """Return the arguments of `start_router`.

    Args:
        arguments: Words after `riot router`.
        environment: Variables of the process.

    Returns:
        None if the command line is not unambiguous.
    """
    if any(each.variable in environment for each in OPTIONS.values()):
        return None
    found: dict[str, Any] = {}
    rest = iter(arguments)
    for argument in rest:
        if argument in _SWITCHES and "bypass_watch" not in found:
            found["bypass_watch"] = _SWITCHES[argument]
            continue
        word, equals, text = argument.partition("=")
        option = OPTIONS.get(word)
        if option is None or (equals and not word.startswith("--")) or (option.name in found and not option.many):
            return None
        text = text if equals else next(rest, "")
        value = None if not text or text.startswith("-") else option.read(text)
        if value is None:
            return None
        if option.many:
            found.setdefault(option.name, []).append(value)
        else:
            found[option.name] = value
    return found


def quick_start(arguments: Sequence[str]) -> bool:
    """Execute a command line if it is an unambiguous `riot router`; return whether it was.

    Args:
        arguments: Words after `riot`.
    """
    found = parse(arguments[1:], os.environ) if arguments[:1] == ["router"] else None
    if found is None:
        return False
    start_router(**found)
    return True


def start_router(
    *,
    system: Path | None = None,
    segment: Sequence[str] | None = None,
    connect: Sequence[str] | None = None,
    cfg: Sequence[str] | None = None,
    name: str | None = None,
    intercept: Sequence[str] | None = None,
    intercept_services: Sequence[str] | None = None,
    interceptor: Sequence[str] | None = None,
    inject: Path | None = None,
    record: Path | None = None,
    type_: Sequence[str] | None = None,
    msg: Sequence[Path] | None = None,
    seed: int = 0,
    budget: float | None = None,
    control: Sequence[str] | None = None,
    bypass_watch: bool = True,
    as_json: bool = False,
) -> None:
    """Run a router until it is told to stop; the arguments are the options of `riot router`."""
    from riot_bus.control.router_flags import RouterFlags
    from riot_bus.control.router_options import RouterOptions
    from riot_bus.control.router_process import run_router

    flags = RouterFlags(
        segments=segment or (),
        connect=connect or (),
        cfg=cfg or (),
        name=name,
        intercept=intercept or (),
        services=intercept_services or (),
        record=record,
        budget=budget,
        control=control or (),
    )
    options = RouterOptions(
        system=system,
        flags=flags,
        interceptors=interceptor or (),
        inject=inject,
        types=type_ or (),
        definitions=msg or (),
        seed=seed,
        bypass_watch=bypass_watch,
    )
    run_router(options, say=say, warn=warn, as_json=as_json)


def say(line: str) -> None:
    """Print a line of the result."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def warn(line: str) -> None:
    """Print a line of diagnostics."""
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()
