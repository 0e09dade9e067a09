"""Commands that a running router, recorder, player or agent accepts, with their arguments and answers.

They come from the network: an error in one is reported in the answer.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from riot_bus.vocabulary.errors import ConfigError, did_you_mean

VERSION = 1
"""Version of the answers' format."""

LARGEST_PAYLOAD = 1 << 20  # any client of a segment may send more; a plan, the largest payload, is a text file
_LARGEST_ARGUMENTS = 1 << 16  # they are a path or a list of keys; parsed JSON takes several times its size
_LARGEST_NUMBER = 1e12  # beyond any log; keeps out NaN, infinity and what overflows as nanoseconds or in SQLite
_LONGEST_NAME = 200  # a guess: bounds what an answer or a message repeats of a sender's text


@dataclass(frozen=True, slots=True)
class CommandRequest:
    """The payload and parameters sent with a command."""

    payload: bytes
    parameters: Mapping[str, str]

    def text(self) -> str:
        """Return the payload as text."""
        try:
            return self.payload.decode("utf-8")
        except UnicodeDecodeError as error:
            raise ConfigError(f"the payload is not UTF-8: {error.reason} at byte {error.start}") from None

    def arguments(self, *known: str) -> dict[str, Any]:
        """Return the payload, a JSON object with no other keys than these; an empty payload gives an empty object."""
        size = len(self.payload)
        if size > _LARGEST_ARGUMENTS:
            raise ConfigError(f"the payload of {size} bytes is too large", hint=f"at most {_LARGEST_ARGUMENTS} bytes")
        try:
            found = json.loads(self.text() or "{}")
        except (ValueError, RecursionError) as error:
            raise ConfigError(f"the payload is not JSON: {error}", hint='such as {"keys": ["/odom"]}') from None
        if not isinstance(found, dict):
            raise ConfigError("the payload is not a JSON object", hint='such as {"keys": ["/odom"]}')
        for other in found.keys() - set(known):
            raise ConfigError(f"unknown argument {other[:80]!r}", hint=did_you_mean(other[:80], known))
        return found

    def number(self, name: str, default: float | None = None) -> float:
        """Return the only argument of the command, a number."""
        return number_of(self.arguments(name).get(name, default), name)

    def keys(self) -> list[str]:
        """Return the argument `keys`."""
        found = self.arguments("keys").get("keys")
        if not isinstance(found, list) or not all(isinstance(each, str) for each in found):
            raise ConfigError("the argument 'keys' is not a list of texts", hint='such as {"keys": ["/odom"]}')
        return found

    def path(self) -> str | None:
        """Return the argument `path`; None if it is not given."""
        found = self.arguments("path").get("path")
        if found is not None and not isinstance(found, str):
            raise ConfigError("the argument 'path' is not a text", hint='such as {"path": "run.mcap"}')
        return found

    def nonce(self) -> str:
        """Return the parameter `nonce`, by which the sender recognises a fresh answer."""
        return self.parameters.get("nonce", "")[:_LONGEST_NAME]

    def name(self) -> str:
        """Return the parameter `name`, as far as it can be shown."""
        name = self.parameters.get("name", "")[:_LONGEST_NAME]
        return name if name and name.isprintable() else "plan"


@dataclass(frozen=True, slots=True)
class Command:
    """A command.

    Attributes:
        run: Function of the service and the request that carries it out and returns the answer.
        reads: Whether it only reads, so that it may be part of a question to all.
        urgent: Whether no other question may delay it; it may then be carried out beside others.
    """

    run: Callable[[Any, CommandRequest], Any]
    reads: bool = False
    urgent: bool = False


def reporting(do: Callable[[Any, CommandRequest], object], *, urgent: bool = False) -> Command:
    """Return a command that is answered with the status of the service after `do`."""

    def run(service: Any, request: CommandRequest) -> Any:
        do(service, request)
        return service.status()

    return Command(run, urgent=urgent)


def number_of(value: Any, name: str) -> float:
    """Return the value of an argument as a number; raises ConfigError if it is not one."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _LARGEST_NUMBER:
        raise ConfigError(f"the argument {name!r} is not a number", hint=f'such as {{"{name}": 2.5}}')
    return float(value)


def answer(
    service: Any,
    router: str,
    name: str,
    payload: bytes,
    parameters: Mapping[str, str],
    *,
    commands: Mapping[str, Command],
) -> bytes:
    """Carry out a command and return the answer as JSON.

    Raises:
        RiotError: The command cannot be carried out.
    """
    if name not in commands:
        raise ConfigError(f"no command {name[:80]!r}", hint=did_you_mean(name[:80], commands))
    result = commands[name].run(service, CommandRequest(payload, parameters))
    document = {"version": VERSION, "router": router, "command": name, "result": result}
    return json.dumps(document, sort_keys=True).encode()


def refusal(router: str, error: Exception) -> bytes:
    """Return why a command was not carried out, as JSON: message, where, hint and exit code."""
    document = {
        "version": VERSION,
        "router": router,
        "message": getattr(error, "message", None) or f"failure of ours: {error!r}",
        "where": getattr(error, "where", None),
        "hint": getattr(error, "hint", None),
        "exit_code": getattr(error, "exit_code", 1),
    }
    return json.dumps(document, sort_keys=True).encode()
