"""An agent: one operation at a time, controlled remotely, and safe when its controller is lost."""

from __future__ import annotations

import json
import logging
import os
import threading
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Self

from riot_bus import __version__
from riot_bus.control.commands import Command, number_of
from riot_bus.control.signals import ended_by_signals
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.redaction import escape_control_chars, redacted
from riot_bus.zenoh.session import open_session, prepare_runtime, release
from riot_bus.zenoh.session_config import client_config
from riot_bus_fleet.agent.library import Library
from riot_bus_fleet.agent.link import FleetLink
from riot_bus_fleet.agent.operations import Play, RecordOperation, check_room
from riot_bus_fleet.agent.proof import proved
from riot_bus_fleet.agent.request import ControllerWatch, PlayRequest, RecordRequest, parse_request

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.control.commands import CommandRequest
    from riot_bus.control.terminal import Foreground
    from riot_bus.vocabulary.errors import RiotError
    from riot_bus_fleet.agent.options import AgentOptions

_LOG = logging.getLogger(__name__)
_Operation = Play | RecordOperation
_END_S = 20.0  # with the link's 15 s below the 40 s of systemd (riot-agent.service)
_LONGEST_WHO = 200  # as `Lead.who`: it becomes part of lines of the journal and the status


class AgentService:
    """The agent of a robot; a context manager, whose end stops the operation. Raises ConfigError for wrong options."""

    def __init__(self, options: AgentOptions, *, say: Callable[[str], None] = _LOG.info) -> None:
        options.check()
        self.options = options
        self.stopping = threading.Event()
        self.failure: RiotError | None = None
        self._sayer = say
        self.library = Library(options.folder, options.robot, catalogue=options.catalogue, failed=self._say)
        self._link = FleetLink(
            self,
            AGENT_COMMANDS,
            options.robot,
            options.commanded_at,
            options.commanded_with,
            say=self._say,
            failed=self._failed,
        )
        self._began = time.monotonic()
        self._lock = threading.Lock()
        self._operation: _Operation | None = None
        self._watch: ControllerWatch | None = None
        self._held = False  # whether the watch has paused it
        self._news = threading.Event()
        self._closing = threading.Event()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.callback(self.library.close)
            self.library.start()
            stack.callback(self._link.close)
            for target, name in ((self._tell, "riot-agent-progress"), (self._attend, "riot-agent-watch")):
                thread = threading.Thread(target=target, name=name, daemon=True)
                stack.callback(thread.join, _END_S)
                thread.start()
            stack.callback(self._closing.set)
            stack.callback(self._end)
            self._link.start()
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def status(self) -> dict[str, Any]:
        """Return the status, as JSON values."""
        with self._lock:
            operation, watch = self._operation, self._watch
        row = None if operation is None else operation.status()
        if row is not None and watch is not None and operation is not None and operation.active:
            row["controller_away"] = round(watch.away(time.monotonic()), 1)
        return {
            "robot": self.options.robot,
            "version": __version__,
            "pid": os.getpid(),
            "uptime": round(time.monotonic() - self._began, 3),
            "bus": redacted(self.options.endpoint),
            "allow": list(self.options.allow),
            "busy": operation is not None and operation.active,
            "operation": row,
        }

    def answer(self, nonce: str) -> dict[str, Any]:
        """Return the status with the proof that it comes from this agent, for the controller that asked."""
        return self._proved(self.status(), nonce)

    def play(self, payload: bytes) -> None:
        """Begin to play."""
        request = parse_request(PlayRequest, payload)
        self._allowed("play")
        files = self.library.resolve_all(request.logs)
        request.check_plan()
        request.options(self.options, files, None)
        self._start(Play(request, request.logs, files, self.options, self._news.set))

    def record(self, payload: bytes) -> None:
        """Begin to record."""
        request = parse_request(RecordRequest, payload)
        self._allowed("record")
        check_room(self.options)
        self._start(RecordOperation(request, request.options(self.options), self.options, self._news.set))

    def pause(self, who: str) -> None:
        """Pause the operation."""
        self._steered(who, "pauses").pause()

    def resume(self, who: str) -> None:
        """Resume the operation."""
        self._steered(who, "resumes").resume()

    def seek(self, seconds: float, who: str) -> None:
        """Continue at a time in seconds from the beginning of what is played."""
        self._steered(who, f"goes to {seconds:g} s of").seek(seconds)

    def set_rate(self, rate: float, who: str) -> None:
        """Continue at another speed."""
        self._steered(who, f"sets the rate to {rate:g} of").set_rate(rate)

    def stop(self, who: str) -> None:
        """End the operation, if there is one."""
        operation = self._operation
        if operation is not None and operation.active:
            operation.stop(f"stopped by {who}")

    def shutdown(self) -> None:
        """Ask the process that runs this agent to end."""
        self.stopping.set()

    def _start(self, operation: _Operation) -> None:
        lead = operation.lead
        with self._lock:
            present = self._operation
            if present is None or present.lead.operation != lead.operation:  # else a repeated request
                if present is not None and present.active:
                    raise self._busy(present)
                self._operation, self._held = operation, False
                watch = ControllerWatch(lead.on_lost_controller, lead.grace, time.monotonic())
                self._watch = watch if lead.watched else None
                operation.start()
                what = ", ".join(operation.status().get("logs", []))
                self._say(f"{operation.kind} for {lead.who}{what and f': {what}'}")
        self._news.set()

    def _proved(self, status: dict[str, Any], nonce: str) -> dict[str, Any]:
        operation = self._operation
        own = operation is not None and (status["operation"] or {}).get("id") == operation.lead.operation
        return proved(status, operation.lead.secret if own and operation is not None else None, nonce)

    def _busy(self, present: _Operation) -> EnvironmentFaultError:
        status, lead = present.status(), present.lead
        what = ", ".join(status.get("logs", [])) or status["kind"]
        since = time.time() - status["since"]
        return EnvironmentFaultError(
            f"{self.options.robot} is busy: {status['kind']} of {what} for {lead.who}, {status['state']}, "
            f"since {since:.0f} s",
            where=self.options.robot,
            hint=f"wait for its end, or end it: riot fleet stop {self.options.robot}",
        )

    def _steered(self, who: str, what: str) -> _Operation:
        operation = self._operation
        if operation is None or not operation.active:
            raise ConfigError("no operation is running", where=self.options.robot, hint="riot fleet play ROBOT LOG")
        self._say(f"{who} {what} the {operation.kind}")
        self._held = False
        return operation

    def _allowed(self, what: str) -> None:
        if what not in self.options.allow:
            allowed = ", ".join(self.options.allow) or "nothing"
            raise ConfigError(f"this agent may not {what}", where=self.options.robot, hint=f"it may: {allowed}")
        others = self._link.others()
        if others:
            text = f"{others + 1} agents are called {self.options.robot!r}, and all of them would {what}"
            raise EnvironmentFaultError(text, where=self.options.robot, hint="give each its own name: --robot NAME")

    def _end(self) -> None:
        operation = self._operation
        if operation is not None and operation.active:
            operation.stop("the agent ends")
            operation.wait(_END_S)

    def _say(self, line: str) -> None:
        self._sayer(escape_control_chars(redacted(line)))

    def _failed(self, error: RiotError) -> None:
        self.failure = error
        self.shutdown()

    def _tell(self) -> None:
        """Publish the progress: about twice a second, and whenever the state has changed."""
        last, told, number = "", 0.0, 0
        while not self._closing.is_set():
            self._news.wait(0.1)  # changes such as a player's do not set the event
            self._news.clear()
            operation = self._operation
            if operation is None:
                continue
            status = self.status()
            state = f"{operation.lead.operation} {status['operation']['state']} {status['operation']['reason']}"
            now = time.monotonic()
            # Four within the 2 s (`_SILENT_S`) after which a controller asks by itself.
            if state == last and (not operation.active or now - told < 0.5):
                continue
            if state != last and not operation.active:
                self._say(f"{operation.kind} {_outcome(status['operation'])}")
            last, told, number = state, now, number + 1
            try:
                self._link.publish(json.dumps(self._proved(status, str(number)), sort_keys=True).encode())
            except Exception:
                _LOG.exception("the progress could not be told")

    def _attend(self) -> None:
        """Watch the controller of the present operation."""
        while not self._closing.wait(0.5):  # six questions that time out fit into the default grace of 10 s
            with self._lock:
                operation, watch = self._operation, self._watch
            if operation is None or watch is None or not operation.active:
                continue
            try:
                present = self._link.sees(operation.lead.operation, operation.lead.secret or "")
            except Exception:
                _LOG.exception("the controller cannot be looked for")
                present = False
            self._act(operation, watch, present=present)

    def _act(self, operation: _Operation, watch: ControllerWatch, *, present: bool) -> None:
        action = watch.look(time.monotonic(), present=present)
        lost = f"the controller was lost for {operation.lead.grace:g} s"
        try:
            if action == "stop":
                operation.stop(lost)
            elif action == "pause" and operation.status()["state"] != "paused":
                self._say(f"paused: {lost}")
                operation.reason, self._held = lost, True
                operation.pause()
            elif action == "resume" and self._held:
                self._say("resumed: the controller is back")
                operation.reason, self._held = "", False
                operation.resume()
        except Exception as error:  # it has just begun or ended
            self._say(f"could not {action} the {operation.kind}: {error}")
            if operation.active:
                operation.stop(lost)


def _outcome(row: dict[str, Any]) -> str:
    problem = row["problem"] or {}
    why = row["reason"] or ": ".join(filter(None, (problem.get("where"), problem.get("message"))))
    return f"{row['state']}: {why}" if why else str(row["state"])


def _who(arguments: dict[str, Any]) -> str:
    who = arguments.get("who", "an unnamed controller")
    if not isinstance(who, str) or len(who) > _LONGEST_WHO:
        raise ConfigError("the argument 'who' is not a text, or too long", hint=f"at most {_LONGEST_WHO} letters")
    return who


def _logs(service: AgentService, request: CommandRequest) -> dict[str, Any]:
    arguments = request.arguments("query", "offset", "limit", "look")
    query = arguments.get("query", "")
    if not isinstance(query, str):
        raise ConfigError("the argument 'query' is not a text", hint='such as {"query": "topic=/odom lossless"}')
    offset, limit = (
        int(number_of(arguments.get(name, default), name)) for name, default in (("offset", 0), ("limit", 100))
    )
    look = int(number_of(arguments["look"], "look")) if "look" in arguments else None
    return service.library.logs(query, offset=offset, limit=limit, look=look)


def _command(do: Callable[[AgentService, CommandRequest], object], *, urgent: bool = False) -> Command:
    """Return a command that answers with the status."""

    def run(service: AgentService, request: CommandRequest) -> dict[str, Any]:
        do(service, request)
        return service.answer(request.nonce())

    return Command(run, urgent=urgent)


def _steer(do: Callable[[AgentService, str], object]) -> Command:
    """Return a command whose only argument is the name of its sender."""
    return _command(lambda service, request: do(service, _who(request.arguments("who"))), urgent=True)


def _number(request: CommandRequest, name: str) -> tuple[float, str]:
    """Return the number that a command takes, and the name of its sender."""
    arguments = request.arguments(name, "who")
    return number_of(arguments.get(name), name), _who(arguments)


AGENT_COMMANDS: dict[str, Command] = {
    "agent/status": Command(lambda service, request: service.answer(request.nonce()), reads=True, urgent=True),
    "agent/logs": Command(_logs, reads=True),
    "agent/play": _command(lambda service, request: service.play(request.payload)),
    "agent/record": _command(lambda service, request: service.record(request.payload)),
    "agent/pause": _steer(AgentService.pause),
    "agent/resume": _steer(AgentService.resume),
    "agent/stop": _steer(AgentService.stop),
    "agent/seek": _command(lambda service, request: service.seek(*_number(request, "time"))),
    "agent/rate": _command(lambda service, request: service.set_rate(*_number(request, "rate"))),
}
"""All commands by name; all but `agent/logs` answer with the status."""


def run_agent(options: AgentOptions, foreground: Foreground) -> None:
    """Run until SIGINT or SIGTERM, then stop the current operation.

    Raises:
        ConfigError: An option is wrong, or Zenoh refuses a configuration.
        EnvironmentFaultError: The link to the fleet failed for good.
    """
    service = AgentService(options, say=foreground.warn)
    with ended_by_signals(service.shutdown), service:
        may = " and ".join(options.allow) or "only list its logs"
        line = f"ready: agent of {options.robot}, logs in {options.folder}; may {may}"
        foreground.report("ready", {"robot": options.robot, "logs": str(options.folder)}, [line])
        _look_at_bus(options, foreground.warn)
        foreground.attend(service.stopping.wait)
    if service.failure is not None:
        raise service.failure


def _look_at_bus(options: AgentOptions, tell: Callable[[str], None]) -> None:
    """Warn if the robot's own bus does not answer; it may come up later."""
    prepare_runtime()
    try:
        release(open_session(client_config(options.endpoint, extra=options.config), purpose="bus of the robot"))
    except EnvironmentFaultError as error:
        tell(f"warning: {error.where}: {error.message}; it is tried again for each operation")
