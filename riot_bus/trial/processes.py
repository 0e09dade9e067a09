"""The processes of one trial's components: started with what is set up for them, and ended."""

from __future__ import annotations

import ctypes
import functools
import json
import logging
import math
import re
import secrets
import signal
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from riot_bus.processes.containers import first_process
from riot_bus.processes.forking import fork_of
from riot_bus.processes.launcher import TORN_DOWN_WITHIN_S
from riot_bus.processes.placement import STARTED, only_some, started_in
from riot_bus.processes.python_report import PythonReport
from riot_bus.processes.resource_limits import amount_text
from riot_bus.processes.ros_domains import domain_environment, start_bridge
from riot_bus.processes.starts import start_of
from riot_bus.processes.supervisor import ADDR_NO_RANDOMIZE
from riot_bus.trial.placeholders import Placeholders, fill
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, RiotError
from riot_bus.zenoh.session import environment_of_others

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, MutableMapping, Sequence
    from pathlib import Path

    from riot_bus.processes.forking import Fork
    from riot_bus.processes.launcher import ComponentProcess, Launcher
    from riot_bus.processes.starts import Start
    from riot_bus.system.system_file import RunPace
    from riot_bus.trial.context import Context
    from riot_bus.vocabulary.message import Scalar

_LOG = logging.getLogger(__name__)
_ENDED_WITHIN_S = 10.0
"""Time that `stop` and the end of its component may take, as long as the command of a reset may, and a killed process,
which dies late if it waits for a disk or a device."""
FIXED: Mapping[str, str] = {
    "LC_ALL": "C.UTF-8",
    "TZ": "UTC",
    "PYTHONHASHSEED": "0",
    "PYTHONUNBUFFERED": "1",  # what was printed last is there when a process is killed
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}
"""Variables of components in trials. One thread for numeric libraries, since sums in another order differ."""


@dataclass(slots=True)
class _Commands:
    """The commands that are executed while a component runs, and the last execution of the one that tells readiness."""

    ready: Sequence[str]
    stop: Sequence[str]
    env: Mapping[str, str]
    cwd: Path
    process: ComponentProcess | None = None
    started: float = -math.inf
    told: str = ""


class TrialProcesses:
    """The processes of components, and what belongs to each: its container, its bridge to DDS; a context manager.

    Args:
        directory: Folder for their output and for what they write to `{trial_dir}`.
        imports: Modules that Python components import, by the component's name, folder and command, since a unit alone
            may have another command; components that are not in it are executed and added, others are forked.
        parameters: Values of {param:NAME} that differ from the nominal ones.

    Attributes:
        started: The started components, by name.
        alike: Text that is the same for components that are started in the same way, by name.
        started_at: Time of the start, in seconds of the monotonic clock, by name.
    """

    def __init__(
        self,
        context: Context,
        launcher: Launcher,
        directory: Path,
        *,
        imports: MutableMapping[str, Sequence[str]] | None = None,
        parameters: Mapping[str, Scalar] | None = None,
    ) -> None:
        self.started: dict[str, ComponentProcess] = {}
        self.alike: dict[str, str] = {}
        self.started_at: dict[str, float] = {}
        self.python = PythonReport(directory)
        nominal = {name: each.nominal for name, each in context.file.external.parameters.items()}
        self._parameters = {**nominal, **(parameters or {})}
        self.placeholders = Placeholders(context.file, directory, slot=launcher.slot, parameters=self._parameters)
        self._file, self._launcher, self._directory = context.file, launcher, directory
        self._imports = {} if imports is None else imports
        self._starts: dict[str, Start] = {}
        self._folders: dict[str, Path] = {}
        self._bridges: dict[str, ComponentProcess] = {}
        self._inside: dict[str, Sequence[int]] = {}
        self._commands: dict[str, _Commands] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """End everything, note what Python components have imported, and give back what was reserved."""
        try:
            for name in self.started:
                self._terminate(name)
            self._launcher.kill_all()
            for name, process in self.started.items():
                if (program := self._program(name)) not in self._imports:
                    self._imports[program] = self.python.imports(process.pid)
        finally:
            self.placeholders.close()

    def alive(self, names: Iterable[str]) -> bool:
        """Return whether all these components still run."""
        return all(self._launcher.alive(self.started[name]) for name in names)

    def wait(self, names: Iterable[str], *, timeout: float) -> bool:
        """Wait until these components have ended; return False after `timeout` seconds."""
        return self._launcher.wait([self.started[name] for name in names], timeout=timeout)

    def start(
        self,
        name: str,
        endpoint: str,
        *,
        segment: str,
        seed: int,
        pace: RunPace | None = None,
        before: Sequence[str] = (),
    ) -> ComponentProcess:
        """Start a component, after what is set up for it.

        Args:
            name: Name of the component.
            endpoint: Endpoint of its segment.
            segment: Name of its segment.
            seed: Value of `{seed}`.
            pace: Values of `{duration}` and `{speed}`.
            before: Words before its command, such as those of a debugger, if the command is executed here.

        Raises:
            ConfigError: The component cannot be started so on this machine, or its setup fails.
            EnvironmentFaultError: The component or its setup cannot be executed.
        """
        component = self._file.components[name]
        before = before if component.is_process else ()
        there = f"tcp/127.0.0.1:{self.placeholders.free_port(f'ssh {name}')}" if component.ssh else endpoint
        called = f"riot-{secrets.token_hex(6)}-{re.sub(r'[^A-Za-z0-9_.-]', '-', name)}"
        words = self.placeholders.of_component(name, there, segment=segment, seed=seed, pace=pace)
        if component.container is not None:
            words["{container}"] = called
        filled = component.filled(lambda text: fill(text, words))
        fixed = self._file.system.surroundings == "fixed"
        surroundings = fixed_environment(component.env) if fixed else {}
        domain = domain_environment(self.placeholders.domain(name), self._directory) if component.dds else {}
        own = {**domain, **filled.env, **surroundings}
        plain = {**environment_of_others(), **own}
        env = plain
        if component.is_process:
            env = env | self.python.environment(env, imports=self._program(name) not in self._imports)
        if component.only is not None:
            env = env | only_some(env, component.only, plan=self._directory / f"{name}.only")
        cwd = self._folders[name] = (self._file.root / ("." if component.ssh else filled.cwd)).resolve()
        start = self._starts[name] = start_of(
            filled,
            called,
            argv=[*before, *filled.command],
            env=own,
            endpoint=endpoint,
            there=there,
            folder=self._directory,
            cwd=cwd,
        )
        modules = self._imports.get(self._program(name), ())
        fresh = 'isolation = "fresh"' if self._file.isolation_of(name) == "fresh" else ""
        asked = fresh if fixed else 'surroundings = "as they are"'
        fork: Fork | str | None = f"riot.toml has {asked}" if asked and modules else None
        if not (asked or before or component.only) and component.is_process:
            varying = {key for key, value in filled.env.items() if component.env[key] != value}
            fork = fork_of(start.argv, env=env, varying=varying, cwd=cwd, modules=modules)
        bridge = self._bridges.get(name)
        if component.dds and (bridge is None or not self._launcher.alive(bridge)):
            number, title = self.placeholders.domain(name), f"{name}.bridge"
            nodes = {str(each.node) for each in self._file.external.in_nodes.values()}
            self._bridges[name] = start_bridge(
                self._launcher,
                title,
                endpoint=endpoint,
                domain=number,
                folder=self._directory,
                parameters=sorted(node for node in nodes if node.startswith("/")),
            )
        around: dict[str, Any] = {"env": env, "cwd": cwd}
        if filled.setup:
            within = component.ready.timeout
            self._carry_out(f"{name}.setup", filled.setup, **around, timeout=within, undo=filled.teardown)
        self._inside.pop(name, None)
        limits = component.limits
        unlimited = before or component.attach is not None or limits == "off"
        try:
            self.started[name] = self._launcher.start(
                name,
                start.argv,
                **around,
                directory=self._directory,
                fixed=fixed,
                fork=fork,
                limits=None if unlimited or limits == "off" else limits.model_dump(),
                script=start.script,
                teardown=start.teardown,
                relayed=start.relayed,
            )
        except EnvironmentFaultError:
            if filled.setup and filled.teardown:
                with suppress(RiotError):
                    self._carry_out(f"{name}.teardown", filled.teardown, **around, timeout=TORN_DOWN_WITHIN_S)
            raise
        pid = str(self.started[name].pid)
        ready, stop = (
            [word.replace("{pid}", pid) for word in each] for each in (filled.ready.command, filled.stop_command)
        )
        self._commands[name] = _Commands(ready, stop, plain, cwd)
        self.started_at[name] = time.monotonic()
        self.alike[name] = repr((name, component.command, before, pace, self._parameters))
        return self.started[name]

    def end(self, names: Iterable[str]) -> None:
        """End components, as `stop` in riot.toml asks for.

        Raises:
            EnvironmentFaultError: One cannot be ended.
        """
        for name in names:
            self._terminate(name)
            process = self.started[name]
            if self._launcher.alive(process):
                self._launcher.interrupt(process, signal.SIGKILL)
            if not self._launcher.wait([process], timeout=_ENDED_WITHIN_S):
                raise EnvironmentFaultError(f"component {name!r} cannot be killed")
            self._launcher.wait([process], timeout=TORN_DOWN_WITHIN_S, torn_down=True)

    def _terminate(self, name: str) -> None:
        """Give a component time to end by itself, if riot.toml says so."""
        process, stop = self.started[name], self._file.components[name].stop
        if stop == "kill" or not self._launcher.alive(process):
            return
        if stop != "term":
            if problem := self._stop(name):
                _log_unstopped(name, f"{stop[0]!r} {problem}")
            return
        self._launcher.interrupt(process, signal.SIGTERM)
        self._launcher.wait([process], timeout=3.0)

    def _stop(self, name: str) -> str | None:
        """Ask a component to end by itself, by the command `stop`; return what is wrong if it goes on, else None."""
        commands, process = self._commands[name], self.started[name]
        try:
            asking = self._launcher.start(
                f"{name}.stop", commands.stop, env=commands.env, cwd=commands.cwd, directory=self._directory
            )
        except EnvironmentFaultError as error:
            return f"cannot be executed: {error.message}"
        deadline = time.monotonic() + _ENDED_WITHIN_S
        asked = self._launcher.wait([asking], timeout=_ENDED_WITHIN_S)
        if asking.status == 0 and self._launcher.wait([process], timeout=deadline - time.monotonic()):
            return None
        if asking.status:
            return f"ended with status {asking.status}; {last_words(asking)}"
        told = "and the component still runs" if asked else "and has not ended itself"
        return f"was executed {_ENDED_WITHIN_S:g} s ago, {told}"

    def why_not_ready(self, name: str) -> str | None:
        """Return what `ready.command` of a component says, and execute it again; None once it has ended with 0."""
        check = self._commands[name]
        if not check.ready or (check.process is not None and check.process.status == 0):
            return None
        if check.process is None or not self._launcher.alive(check.process):
            check.told = "" if check.process is None else f" ended with status {check.process.status}"
            if time.monotonic() - check.started >= 0.1:  # seconds between two executions
                check.started = time.monotonic()
                check.process = self._launcher.start(
                    f"{name}.ready", check.ready, env=check.env, cwd=check.cwd, directory=self._directory
                )
        return f"is not ready: {check.ready[0]!r}{check.told or ' has not ended'}"

    def folder_of(self, name: str) -> Path:
        """Return where a component's code is: its working folder."""
        return self._folders[name]

    def execute(self, name: str, command: Sequence[str], *, timeout: float) -> None:
        """Execute a command of riot.toml that belongs to no component, such as a reset, to its end.

        Raises:
            ConfigError: It fails.
            EnvironmentFaultError: It cannot be executed, or takes longer than `timeout` seconds.
        """
        words = self.placeholders.of_command(tuple(command))
        filled = [fill(word, words) for word in command]
        self._carry_out(name, filled, env=environment_of_others(), cwd=self._file.root, timeout=timeout)

    def _carry_out(
        self,
        name: str,
        command: Sequence[str],
        *,
        env: Mapping[str, str],
        cwd: Path,
        timeout: float,
        undo: Sequence[str] = (),
    ) -> None:
        """Execute a command to its end, and `undo` if it fails; the output is kept in files with its name."""
        where = self._file.path
        process = self._launcher.start(
            name, command, env=env, cwd=cwd, directory=self._directory, teardown=undo, undoes=True
        )
        if not self._launcher.wait([process], timeout=timeout):
            told = f"{name}: {command[0]!r} has not ended within {timeout:g} s"
            raise EnvironmentFaultError(told, where=str(where), hint=last_words(process))
        if process.status:
            told = f"{name}: {command[0]!r} ended with status {process.status}"
            raise ConfigError(told, where=str(where), hint=last_words(process))

    def _program(self, name: str) -> str:
        """Return the key that identifies a component's program in `imports`."""
        component = self._file.components[name]
        return " ".join((name, component.cwd, *component.command))

    def find_inside(self, name: str) -> None:
        """Find the processes of a ready component that are not descendants of riot's, and check `only`.

        Raises:
            ConfigError: The component's command has started no process that matches `only` in riot.toml.
        """
        start, process = self._starts[name], self.started[name]
        if (only := self._file.components[name].only) is not None:
            found = started_in((self._directory / f"{name}.only").with_suffix(STARTED))
            if not found.chosen:
                others = ", ".join(sorted(found.others)) or "nothing by Python's subprocess"
                told = f"nothing that {name!r} has started is called {only!r}"
                raise ConfigError(
                    told, where=f"{self._file.path}: [components.{name}] only", hint=f"it started {others}"
                )
        if start.container and name not in self._inside and (pid := first_process(start.engine, start.container)):
            self._inside[name] = [pid]
            self._launcher.include(process, self._inside[name])
        if self._file.components[name].attach is not None:
            self._inside[name] = json.loads(process.printed().partition("\n")[0])

    def roots(self, names: Iterable[str]) -> tuple[int, ...]:
        """Return the processes that all others of components descend from."""
        found = []
        for name in names:
            found.append(self.started[name].pid)
            found += self._inside.get(name, ())
            found += [self._bridges[name].pid] if name in self._bridges else []
        return tuple(found)

    def excess(self, name: str) -> tuple[str, str] | None:
        """Return the resource whose limit ended a component, with a text about the amount; None if none did."""
        excess, limits = self.started[name].excess, self._file.components[name].limits
        if excess is None or limits == "off":
            return None
        what, had = excess
        most = amount_text(what, getattr(limits, what))
        return what, f"it had {what} of {amount_text(what, had)}, and [components.{name}] limits it to {most}"

    def bridge_of(self, name: str) -> ComponentProcess | None:
        """Return the bridge of a component to DDS; None if it has none."""
        return self._bridges.get(name)

    def runs(self, name: str) -> bool:
        """Return whether a component runs, and its bridge if it has one."""
        processes = [self.started[name], *([self._bridges[name]] if name in self._bridges else [])]
        return all(map(self._launcher.alive, processes))

    def check_way(self, name: str) -> None:
        """Check that the bridge or connection to a component has not ended, which is not a failure of the component.

        Raises:
            EnvironmentFaultError: The bridge or connection has ended.
        """
        start, process, bridge = self._starts[name], self.started[name], self._bridges.get(name)
        if bridge is not None and not self._launcher.alive(bridge):
            ended, what = bridge, "the bridge to DDS"
        elif start.lost is not None and process.status == start.lost:
            ended, what = process, repr(start.argv[0])
        else:
            return
        raise EnvironmentFaultError(
            f"{what} of component {name!r} ended with status {ended.status}",
            where=str(self._file.path),
            hint=last_words(ended),
        )


@functools.cache
def _log_unstopped(name: str, what: str) -> None:
    _LOG.warning("component %r is killed: its stop command %s", name, what)


def last_words(process: ComponentProcess) -> str:
    """Return the end of what a process has written to stderr, as a hint."""
    lines = process.errors().strip().splitlines()
    tail = "\n    ".join(lines[-6:])
    return f"its last words on stderr:\n    {tail}" if lines else "it wrote nothing to stderr"


def fixed_environment(given: Mapping[str, str]) -> dict[str, str]:
    """Return the fixed variables except those that the component's `env` in riot.toml sets itself."""
    return {name: value for name, value in FIXED.items() if name not in given}


@functools.cache
def fixes_addresses() -> bool:
    """Return whether the kernel lets processes have the same addresses each time; in some containers it does not."""
    personality = ctypes.CDLL(None).personality
    before = personality(0xFFFFFFFF)
    fixed = before != -1 and personality(before | ADDR_NO_RANDOMIZE) != -1
    if fixed:
        personality(before)
    return bool(fixed)
