"""The controller's side of an agent: finds robots, makes one play, and follows it, with a limit on every wait."""

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

from riot_bus.control.commands import LARGEST_PAYLOAD
from riot_bus.control.remote import ForgedAnswerError, Remote, document_of
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.session import release
from riot_bus.zenoh.session_config import OWN_CHUNK
from riot_bus_fleet.agent.names import ALL_AGENTS, check_robot, controller_key, progress_key
from riot_bus_fleet.agent.operation import FINAL
from riot_bus_fleet.agent.proof import is_proved, new_secret, prove

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh

_FIND_S = 3.0  # as in riot_bus.control.remote: one agent that hangs delays the list by as much
_BEGIN_S = 20.0  # generous: agents look up logs and check plans before they answer; not measured
_STOP_S = 10.0  # as docs/fleet.md says; an agent that hangs must not keep the terminal for longer
_SILENT_S = 2.0  # four missed messages of progress, which come every 0.5 s
_LOOK_S = 0.2  # so late Ctrl-C is noticed; `riot agent acl` allows 20 questions for logs a second
_LOOKING_S = 5.0  # scans may rest for 20 s (library.py): then people get the list so far


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot on which an agent runs.

    Attributes:
        agents: Number of agents with this name; more than one is a mistake.
        status: Status from the agent; None if it does not answer, or may not be asked.
    """

    name: str
    agents: int
    status: Mapping[str, Any] | None


def find_robots(endpoint: str, *, config: Mapping[str, Any] | None = None) -> list[Robot]:
    """Return the robots whose agents are connected, by name; raises EnvironmentFaultError if no router answers."""
    from riot_bus.zenoh import api as zenoh

    with Remote(endpoint, config=config, kind="agent") as remote:
        session = remote.client.session
        found = session.liveliness().get(ALL_AGENTS, timeout=_FIND_S)
        tokens = {str(reply.ok.key_expr) for reply in found if reply.ok is not None}
        answers = {}
        for reply in session.get(f"{OWN_CHUNK}/*/agent/status", target=zenoh.QueryTarget.ALL, timeout=_FIND_S):
            if reply.ok is not None and len(reply.ok.payload) <= LARGEST_PAYLOAD:
                document = document_of(reply.ok.payload.to_bytes())
                answers[str(reply.ok.key_expr).split("/")[1]] = document.get("result")
    names = [token.split("/")[1] for token in tokens]
    told = ((name, answers.get(name)) for name in sorted(set(names)))
    return [Robot(name, names.count(name), status if isinstance(status, dict) else None) for name, status in told]


def ask_robot(
    endpoint: str, robot: str, command: str, *, config: Mapping[str, Any] | None = None, **arguments: Any
) -> dict[str, Any]:
    """Ask a robot's agent one question; raises EnvironmentFaultError without an answer, and its own errors."""
    check_robot(robot, where="ROBOT")
    with Remote(endpoint, robot, config=config, kind="agent") as remote:
        return remote.ask(f"agent/{command}", json.dumps(arguments).encode(), timeout=_BEGIN_S)


def list_logs(
    endpoint: str, robot: str, *, config: Mapping[str, Any] | None = None, **arguments: Any
) -> dict[str, Any]:
    """Return the logs that a robot holds, once its agent has looked for new ones, or some seconds later."""
    check_robot(robot, where="ROBOT")
    with Remote(endpoint, robot, config=config, kind="agent") as remote:
        deadline = time.monotonic() + _LOOKING_S
        while True:
            answer = remote.ask("agent/logs", json.dumps(arguments).encode(), timeout=_BEGIN_S)
            if answer.get("complete") or time.monotonic() >= deadline:
                return answer
            time.sleep(_LOOK_S)
            arguments["look"] = answer.get("look")


def who_am_i() -> str:
    """Return the name of this controller for robots."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):
        user = "unknown"
    return f"{user}@{socket.gethostname()}"[:200]


class RemoteOperation:
    """One operation on a robot, which it starts and follows; a context manager.

    While it is open, it proves to the robot's agent on request that it is present, and it trusts a status of the
    operation only with a proof that it comes from the agent. Both use a secret of this operation alone.

    Raises:
        EnvironmentFaultError: No router answers.
    """

    def __init__(self, endpoint: str, robot: str, *, config: Mapping[str, Any] | None = None) -> None:
        check_robot(robot, where="ROBOT")
        self.robot = robot
        self.operation = secrets.token_hex(8)
        self._secret = new_secret()
        self._told = 0
        self._endpoint = endpoint
        self._bell = threading.Condition()
        self._newest: dict[str, Any] | None = None
        self._remote = Remote(endpoint, robot, config=config, kind="agent")
        try:
            client = self._remote.client
            client.subscribe(progress_key(robot), self._take)
            self._presence: Any = client.session.declare_queryable(
                controller_key(robot, self.operation), self._prove_presence
            )
        except BaseException:
            self._remote.client.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        from riot_bus.zenoh import api as zenoh

        with suppress(zenoh.ZError):  # the link may hang
            release(self._presence)
        with suppress(zenoh.ZError):
            self._remote.client.close()

    def begin(self, kind: str, arguments: Mapping[str, Any], *, watched: bool = True) -> dict[str, Any]:
        """Start; return the status. Raises EnvironmentFaultError if busy or silent, ConfigError if refused."""
        lead = {"operation": self.operation, "secret": self._secret, "watched": watched, "who": who_am_i()}
        return self._own(self._ask(kind, {**lead, **arguments}, timeout=_BEGIN_S))

    def follow(
        self,
        told: Callable[[dict[str, Any] | None, float], None],
        *,
        give_up: float,
        until: Callable[[Mapping[str, Any]], bool] = lambda _: False,
        interrupted: Callable[[], bool] = lambda: False,
    ) -> dict[str, Any]:
        """Follow the operation to its end, through breaks of the link.

        Args:
            interrupted: Function that is called often; once it returns true, the robot is stopped, then followed.

        Raises:
            EnvironmentFaultError: The robot was silent for too long, or no longer knows the operation.
            ForgedAnswerError: An answer does not come from the robot's agent.
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
        """Return the status of this operation."""
        status = answer.get("operation")
        if not isinstance(status, dict) or status.get("id") != self.operation or "state" not in status:
            who = f"it is busy for {status.get('who')}" if isinstance(status, dict) and answer.get("busy") else ""
            raise EnvironmentFaultError(
                f"{self.robot} no longer knows of it: its agent was started anew, or another controller took over",
                where=self.robot,
                hint=who or f"riot fleet status {self.robot}",
            )
        return status

    def _prove_presence(self, query: zenoh.Query) -> None:
        with query:
            nonce = query.payload.to_bytes()[:100].decode(errors="replace") if query.payload else ""
            query.reply(query.key_expr, prove(self._secret, "controller", nonce))

    def _take(self, message: Message) -> None:
        found = {} if len(message.payload) > LARGEST_PAYLOAD else document_of(message.payload)
        operation, proof = found.get("operation"), found.get("proof")
        number = proof.get("nonce") if isinstance(proof, dict) else None
        if not isinstance(operation, dict) or operation.get("id") != self.operation or "state" not in operation:
            return
        if not isinstance(number, str) or not number.isdecimal() or not is_proved(found, self._secret, number):
            return  # not from the agent
        with self._bell:
            if int(number) > self._told:  # otherwise it is an old one
                self._told, self._newest = int(number), found
                self._bell.notify_all()

    def _ask(self, command: str, arguments: Mapping[str, Any], *, timeout: float) -> dict[str, Any]:
        """Ask the agent; a status of this operation needs a proof that it is the agent's and new."""
        nonce = new_secret()
        payload = json.dumps(arguments).encode()
        answer = self._remote.ask(f"agent/{command}", payload, parameters=f"nonce={nonce}", timeout=timeout)
        operation = answer.get("operation")
        own = isinstance(operation, dict) and operation.get("id") == self.operation
        if own and not is_proved(answer, self._secret, nonce):
            hint = "another process answers for it: use access control (riot agent acl), and look: riot doctor --acl"
            text = f"an answer to {command!r} does not prove to come from {self.robot}"
            raise ForgedAnswerError(text, where=self._endpoint, hint=hint)
        return answer

    def _news(self) -> dict[str, Any] | None:
        with self._bell:
            self._bell.wait_for(lambda: self._newest is not None, _LOOK_S)
            found, self._newest = self._newest, None
            return found

    def _try(self, command: str, arguments: Mapping[str, Any]) -> dict[str, Any] | None:
        """Ask; return None without an answer in time."""
        try:
            return self._ask(command, arguments, timeout=2.0)  # Ctrl-C is not noticed meanwhile
        except ForgedAnswerError:
            raise
        except EnvironmentFaultError:
            return None

    def _lost(self, seconds: float, *, told_to_stop: bool) -> EnvironmentFaultError:
        hint = f"its agent does what --on-lost-controller says; look with: riot fleet status {self.robot}"
        if told_to_stop and seconds < _SILENT_S:
            text = f"{self.robot} was told to stop, but has not ended within {_STOP_S:g} s"
        else:
            text = f"{self.robot} was not heard for {seconds:.0f} s"
        return EnvironmentFaultError(text, where=self._endpoint, hint=hint)
