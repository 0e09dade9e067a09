"""What an agent can be told from afar, under `@riot/<robot>/agent/`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.control.commands import Command
from riot_bus.vocabulary.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.agent.service import AgentService
    from riot_bus.control.commands import CommandRequest

__all__ = ["AGENT_COMMANDS"]

_LARGEST = 1e12
_LONGEST_WHO = 200
_ROWS = 100


def _arguments(request: CommandRequest, *names: str) -> dict[str, Any]:
    found = request.arguments()
    for other in found.keys() - set(names):
        raise ConfigError(f"unknown argument {other[:80]!r}", hint=did_you_mean(other[:80], names))
    return found


def _number(found: Any, name: str) -> float:
    if isinstance(found, bool) or not isinstance(found, int | float) or not abs(found) <= _LARGEST:
        raise ConfigError(f"the argument {name!r} is no number", hint=f'such as {{"{name}": 2.5}}')
    return float(found)


def _who(arguments: dict[str, Any]) -> str:
    who = arguments.get("who", "somebody")
    if not isinstance(who, str) or len(who) > _LONGEST_WHO:
        raise ConfigError("the argument 'who' is no text, or too long", hint=f"at most {_LONGEST_WHO} letters")
    return who


def _logs(service: AgentService, request: CommandRequest) -> dict[str, Any]:
    arguments = _arguments(request, "query", "offset", "limit")
    query = arguments.get("query", "")
    if not isinstance(query, str):
        raise ConfigError("the argument 'query' is no text", hint='such as {"query": "topic=/odom lossless"}')
    offset, limit = (
        int(_number(arguments.get(name, default), name)) for name, default in (("offset", 0), ("limit", 100))
    )
    return service.library.logs(query, offset=offset, limit=limit)


def _steer(do: Callable[[AgentService, str], object]) -> Command:
    """Return a command whose only argument is who gives it."""

    def run(service: AgentService, request: CommandRequest) -> dict[str, Any]:
        do(service, _who(_arguments(request, "who")))
        return service.status()

    return Command(run)


def _adjust(name: str, do: Callable[[AgentService, float, str], object]) -> Command:
    """Return a command that takes a number."""

    def run(service: AgentService, request: CommandRequest) -> dict[str, Any]:
        arguments = _arguments(request, name, "who")
        do(service, _number(arguments.get(name), name), _who(arguments))
        return service.status()

    return Command(run)


AGENT_COMMANDS: dict[str, Command] = {
    "agent/status": Command(lambda service, _: service.status(), reads=True),
    "agent/logs": Command(_logs, reads=True),
    "agent/play": Command(lambda service, request: service.play(request.payload)),
    "agent/record": Command(lambda service, request: service.record(request.payload)),
    "agent/pause": _steer(lambda service, who: service.pause(who)),
    "agent/resume": _steer(lambda service, who: service.resume(who)),
    "agent/stop": _steer(lambda service, who: service.stop(who)),
    "agent/seek": _adjust("time", lambda service, time, who: service.seek(time, who)),
    "agent/rate": _adjust("rate", lambda service, rate, who: service.set_rate(rate, who)),
}
"""All commands by name; all but `agent/logs` answer with the status."""
