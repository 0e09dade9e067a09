"""The other side of an agent: finds robots, lets one play, follows it, and never waits without a bound."""

from __future__ import annotations

import getpass
import json
import secrets
import socket
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from riot_bus.agent.names import ALL_AGENTS, check_robot, controller_token, progress_key
from riot_bus.agent.operation import FINAL
from riot_bus.control.remote import Remote
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import release
from riot_bus.zenoh.session_config import OWN_CHUNK

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus.vocabulary.message import Message

__all__ = ["RemoteOperation", "Robot", "ask_robot", "find_robots", "who_am_i"]

_FIND_S = 3.0
_BEGIN_S = 20.0
_ASK_S = 2.0
_STOP_S = 10.0
_SILENT_S = 2.0
_LOOK_S = 0.2
_LARGEST = 1 << 20


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot on which an agent runs.

    Attributes:
        name: Its name.
        agents: How many agents have it; more than one is a mistake.
        status: What the agent says; None if it does not answer, or may not be asked.
    """

    name: str
    agents: int
    status: Mapping[str, Any] | None


def find_robots(endpoint: str, *, config: Mapping[str, Any] | None = None) -> list[Robot]:
    """Return the robots whose agents are connected, by name.

    Args:
        endpoint: The fleet's router.
        config: Further Zenoh configuration.

    Raises:
        EnvironmentFaultError: No router answers.
    """
    from riot_bus.zenoh import api as zenoh

    with Remote(endpoint, config=config, kind="agent") as remote:
        session = remote.client.session
        tokens = {
            str(reply.ok.key_expr)
            for reply in session.liveliness().get(ALL_AGENTS, timeout=_FIND_S)
            if reply.ok is not None
        }
        answers = {}
        for reply in session.get(f"{OWN_CHUNK}/*/agent/status", target=zenoh.QueryTarget.ALL, timeout=_FIND_S):
            if reply.ok is not None:
                document = _document(reply.ok.payload.to_bytes())
                answers[str(reply.ok.key_expr).split("/")[1]] = document.get("result")
    names = [token.split("/")[1] for token in tokens]
    found = ((name, answers.get(name)) for name in sorted(set(names)))
    return [Robot(name, names.count(name), status if isinstance(status, dict) else None) for name, status in found]


def ask_robot(
    endpoint: str, robot: str, command: str, *, config: Mapping[str, Any] | None = None, **arguments: Any
) -> dict[str, Any]:
    """Ask a robot's agent one question.

    Args:
        endpoint: The fleet's router.
        robot: Its name.
        command: Such as `status`, without `agent/`.
        config: Further Zenoh configuration.
        arguments: What the command wants.

    Raises:
        EnvironmentFaultError: No router or no such robot answers.
        RiotError: What the agent says.
    """
    check_robot(robot, where="ROBOT")
    with Remote(endpoint, robot, config=config, kind="agent") as remote:
        return remote.ask(f"agent/{command}", json.dumps(arguments).encode(), timeout=_BEGIN_S)


def who_am_i() -> str:
    """Return how robots call this controller."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):
        user = "somebody"
    return f"{user}@{socket.gethostname()}"[:200]


class RemoteOperation:
    """Lets a robot do one operation, and follows it; a context manager.

    As long as it is open, its liveliness token tells the robot that somebody watches.

    Args:
        endpoint: The fleet's router.
        robot: The robot.
        config: Further Zenoh configuration.

    Raises:
        EnvironmentFaultError: No router answers.
    """

    def __init__(self, endpoint: str, robot: str, *, config: Mapping[str, Any] | None = None) -> None:
        check_robot(robot, where="ROBOT")
        self.robot = robot
        self.operation = secrets.token_hex(8)
        self._endpoint = endpoint
        self._bell = threading.Condition()
        self._newest: dict[str, Any] | None = None
        self._remote = Remote(endpoint, robot, config=config, kind="agent")
        try:
            client = self._remote.client
            client.subscribe(progress_key(robot), self._take)
            self._token: Any = client.session.liveliness().declare_token(controller_token(robot, self.operation))
        except BaseException:
            self._remote.client.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        from riot_bus.zenoh import api as zenoh

        with suppress(zenoh.ZError):  # the link may hang
            release(self._token)
        with suppress(zenoh.ZError):
            self._remote.client.close()

    def begin(self, kind: str, arguments: Mapping[str, Any], *, watched: bool = True) -> dict[str, Any]:
        """Let the robot begin; return its status.

        Args:
            kind: `play` or `record`.
            arguments: What the agent wants to know besides.
            watched: Whether this controller stays.

        Raises:
            EnvironmentFaultError: The robot does not answer, or is busy.
            ConfigError: It refuses.
        """
        document = {"operation": self.operation, "who": who_am_i(), **arguments}
        if watched:
            document["controller"] = self.operation
        answer = self._remote.ask(f"agent/{kind}", json.dumps(document).encode(), timeout=_BEGIN_S)
        return self._own(answer)

    def follow(
        self,
        told: Callable[[dict[str, Any] | None, float], None],
        *,
        give_up: float,
        until: Callable[[Mapping[str, Any]], bool] = lambda status: status["state"] in FINAL,
        interrupted: Callable[[], bool] = lambda: False,
    ) -> dict[str, Any]:
        """Follow the operation to its end, over breaks of the link.

        Args:
            told: Called with each new status, or None and for how many seconds nothing was heard.
            give_up: Seconds without an answer after which it is given up.
            until: Says whether this status is the one that is waited for.
            interrupted: Asked often; when it says so, the robot is told to stop and the end waited for.

        Raises:
            EnvironmentFaultError: The robot was not heard for too long, or no longer knows the operation.
        """
        heard = asked = time.monotonic()
        stop_by = None
        while True:
            now = time.monotonic()
            if stop_by is None and interrupted():
                stop_by = now + min(_STOP_S, give_up)
                self._try("stop", {"who": who_am_i()})
            answer = self._news()
            if answer is None and now - max(heard, asked) > (_SILENT_S if stop_by is None else _LOOK_S):
                asked = time.monotonic()
                answer = self._try("status", {})
                if answer is not None and stop_by is not None and self._own(answer)["state"] not in FINAL:
                    self._try("stop", {"who": who_am_i()})
            now = time.monotonic()
            if answer is not None:
                heard = now
                status = self._own(answer)
                told(status, 0.0)
                if until(status) or status["state"] in FINAL:
                    return status
            elif now - heard > _SILENT_S:
                told(None, now - heard)
            if now - heard > give_up or (stop_by is not None and now > stop_by):
                raise self._lost(now - heard, told_to_stop=stop_by is not None)

    def _own(self, answer: Mapping[str, Any]) -> dict[str, Any]:
        """Return the status of this drive's operation."""
        status = answer.get("operation")
        if not isinstance(status, dict) or status.get("id") != self.operation or "state" not in status:
            who = f"it is busy for {status.get('who')}" if isinstance(status, dict) and answer.get("busy") else ""
            raise EnvironmentFaultError(
                f"{self.robot} no longer knows of it: its agent was started anew, or somebody else took over",
                where=self.robot,
                hint=who or f"riot fleet status {self.robot}",
            )
        return status

    def _take(self, message: Message) -> None:
        found = _document(message.payload)
        operation = found.get("operation")
        if isinstance(operation, dict) and operation.get("id") == self.operation and "state" in operation:
            with self._bell:
                self._newest = found
                self._bell.notify_all()

    def _news(self) -> dict[str, Any] | None:
        with self._bell:
            self._bell.wait_for(lambda: self._newest is not None, _LOOK_S)
            found, self._newest = self._newest, None
            return found

    def _try(self, command: str, arguments: Mapping[str, Any]) -> dict[str, Any] | None:
        """Ask; return None if nobody answers in time."""
        with suppress(EnvironmentFaultError):
            return self._remote.ask(f"agent/{command}", json.dumps(arguments).encode(), timeout=_ASK_S)
        return None

    def _lost(self, seconds: float, *, told_to_stop: bool) -> EnvironmentFaultError:
        hint = f"its agent does what --on-lost-controller says; look with: riot fleet status {self.robot}"
        if told_to_stop and seconds < _SILENT_S:
            text = f"{self.robot} was told to stop, but has not ended within {_STOP_S:g} s"
        else:
            text = f"{self.robot} was not heard for {seconds:.0f} s"
        return EnvironmentFaultError(text, where=self._endpoint, hint=hint)


def _document(data: bytes) -> dict[str, Any]:
    """Return what somebody sent as a JSON object; an empty one if it is none."""
    if len(data) > _LARGEST:
        return {}
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
