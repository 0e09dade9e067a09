"""The commands that a running router takes: their names, what they want and what they answer; pure but for the service.

All of them come from the network: whatever is wrong with one is said in an answer.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from riot_bus.control.status import count_rows, loss_rows
from riot_bus.vocabulary.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus.control.router_service import RouterService

__all__ = ["COMMANDS", "LARGEST_PAYLOAD", "VERSION", "Command", "CommandRequest", "answer", "find_command", "refusal"]

VERSION = 1
"""Version of the answers' format."""

LARGEST_PAYLOAD = 1 << 20
_LARGEST_ARGUMENTS = 1 << 16
_LONGEST_NAME = 200


@dataclass(frozen=True, slots=True)
class CommandRequest:
    """What somebody sent along with a command."""

    payload: bytes
    parameters: Mapping[str, str]

    def text(self) -> str:
        """Return the payload as text."""
        try:
            return self.payload.decode("utf-8")
        except UnicodeDecodeError as error:
            raise ConfigError(f"the payload is not UTF-8: {error.reason} at byte {error.start}") from None

    def arguments(self) -> dict[str, Any]:
        """Return the payload as a JSON object; none is an empty one."""
        if len(self.payload) > _LARGEST_ARGUMENTS:
            raise ConfigError(f"{len(self.payload)} bytes are too many", hint=f"at most {_LARGEST_ARGUMENTS}")
        try:
            found = json.loads(self.text() or "{}")
        except (ValueError, RecursionError) as error:
            raise ConfigError(f"the payload is not JSON: {error}", hint='such as {"keys": ["/odom"]}') from None
        if not isinstance(found, dict):
            raise ConfigError("the payload is no JSON object", hint='such as {"keys": ["/odom"]}')
        return found

    def argument(self, name: str) -> Any:
        """Return the only argument that the command knows; None if it is not given."""
        found = self.arguments()
        for other in found.keys() - {name}:
            raise ConfigError(f"unknown argument {other[:80]!r}", hint=did_you_mean(other[:80], [name]))
        return found.get(name)

    def keys(self) -> list[str]:
        """Return the argument `keys`."""
        found = self.argument("keys")
        if not isinstance(found, list) or not all(isinstance(each, str) for each in found):
            raise ConfigError("the argument 'keys' is no list of texts", hint='such as {"keys": ["/odom"]}')
        return found

    def path(self) -> str | None:
        """Return the argument `path`."""
        found = self.argument("path")
        if found is not None and not isinstance(found, str):
            raise ConfigError("the argument 'path' is no text", hint='such as {"path": "run.mcap"}')
        return found

    def name(self) -> str:
        """Return the parameter `name`, as far as it can be shown."""
        name = self.parameters.get("name", "")[:_LONGEST_NAME]
        return name if name and name.isprintable() else "plan"


@dataclass(frozen=True, slots=True)
class Command:
    """A command: what it does, and whether it only reads, so that a question to all may mean it."""

    run: Callable[[Any, CommandRequest], Any]
    reads: bool = False


def _counts(service: RouterService, request: CommandRequest) -> dict[str, Any]:
    return {"counts": count_rows(service.counts()), "losses": loss_rows(service.losses)}


def _graph(service: RouterService, request: CommandRequest) -> dict[str, Any]:
    from riot_bus.graph.render import VERSION as GRAPH_VERSION

    return {"version": GRAPH_VERSION, **asdict(service.graph())}


COMMANDS: dict[str, Command] = {
    "status": Command(lambda service, _: service.status(), reads=True),
    "counts": Command(_counts, reads=True),
    "graph": Command(_graph, reads=True),
    "intercept/add": Command(lambda service, request: {"intercepted": service.intercept_add(request.keys())}),
    "intercept/remove": Command(lambda service, request: {"intercepted": service.intercept_remove(request.keys())}),
    "plan/load": Command(lambda service, request: service.plan_load(request.text(), request.name())),
    "plan/clear": Command(lambda service, _: service.plan_clear()),
    "record/start": Command(lambda service, request: service.record_start(request.path())),
    "record/stop": Command(lambda service, _: service.record_stop()),
    "record/split": Command(lambda service, request: service.record_split(request.path())),
}
"""All commands by name."""


def find_command(name: str, commands: Mapping[str, Command] = COMMANDS) -> Command:
    """Return a command; raises ConfigError if there is none of this name."""
    try:
        return commands[name]
    except KeyError:
        raise ConfigError(f"no command {name[:80]!r}", hint=did_you_mean(name[:80], commands)) from None


def answer(
    service: Any,
    router: str,
    name: str,
    payload: bytes,
    parameters: Mapping[str, str],
    *,
    commands: Mapping[str, Command] = COMMANDS,
) -> bytes:
    """Carry out a command and return the answer as JSON.

    Args:
        service: The router, or what else the commands are for.
        router: Its name.
        name: The command.
        payload: What was sent along.
        parameters: What the question says besides.
        commands: What can be done.

    Raises:
        RiotError: It cannot be done.
    """
    result = find_command(name, commands).run(service, CommandRequest(payload, parameters))
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
