"""Start of the components of one trial: fills in placeholders, and sets up what else the components need."""

from __future__ import annotations

import ctypes
import functools
import json
import math
import os
import random
import re
import secrets
import socket
import sys
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from riot_bus.processes.containers import first_process
from riot_bus.processes.forking import fork_of
from riot_bus.processes.launcher import TORN_DOWN_WITHIN_S
from riot_bus.processes.placement import STARTED, only_some, started_in
from riot_bus.processes.ros_domains import domain_environment, free_domains, start_bridge
from riot_bus.processes.starts import start_of
from riot_bus.processes.supervisor import ADDR_NO_RANDOMIZE
from riot_bus.system.system_file import FREE_PORT
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, RiotError
from riot_bus.zenoh.session import environment_of_others

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, MutableMapping, Sequence
    from pathlib import Path

    from riot_bus.processes.forking import Fork
    from riot_bus.processes.launcher import ComponentProcess, Launcher
    from riot_bus.processes.python_report import PythonReport
    from riot_bus.processes.starts import Start
    from riot_bus.system.system_file import RunPace
    from riot_bus.trial.context import Context
    from riot_bus.vocabulary.message import Scalar

_PORTS = range(15_000, 32_000)
"""Ports below those that the kernel assigns, so that none is taken before the component listens there."""
_CHECKED_EVERY_S = 0.1
"""Shortest time between two executions of `ready.command`."""
_STOPPED_WITHIN_S = 10.0
"""Time that `stop` and the end of its component may take, as long as the command of a reset may."""
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


class ComponentStarter:
    """Starts components and knows what belongs to each: its process, its container, its bridge to DDS.

    Args:
        context: Context of the system.
        launcher: Owner of the processes.
        directory: Folder of the trial.
        python: Reports of Python components.
        imports: Modules that Python components import, by program (see `TrialSetup`).
        parameters: Values of {param:NAME}.
    """

    def __init__(
        self,
        context: Context,
        launcher: Launcher,
        directory: Path,
        *,
        python: PythonReport,
        imports: MutableMapping[str, Sequence[str]],
        parameters: Mapping[str, Scalar],
    ) -> None:
        self._file, self._launcher, self._directory = context.file, launcher, directory
        self._python, self._imports, self._parameters = python, imports, parameters
        self._processes: dict[str, ComponentProcess] = {}
        self._starts: dict[str, Start] = {}
        self._folders: dict[str, Path] = {}
        self._bridges: dict[str, ComponentProcess] = {}
        self._inside: dict[str, Sequence[int]] = {}
        self._commands: dict[str, _Commands] = {}
        self._ports: dict[str, int] = {}
        self._domains: dict[str, int] = {}
        self._reserved = ExitStack()

    def close(self) -> None:
        """Note what Python components have imported, and give back what was reserved for the trial."""
        with self._reserved:
            for name, process in self._processes.items():
                if (program := self._program(name)) not in self._imports:
                    self._imports[program] = self._python.imports(process.pid)

    def start(
        self, name: str, endpoint: str, *, segment: str, seed: int, pace: RunPace | None, before: Sequence[str]
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
        there = f"tcp/127.0.0.1:{self.free_port(f'ssh {name}')}" if component.ssh else endpoint
        called = f"riot-{secrets.token_hex(6)}-{re.sub(r'[^A-Za-z0-9_.-]', '-', name)}"
        words = self._words(name, there, segment=segment, seed=seed, pace=pace)
        if component.container is not None:
            words["{container}"] = called
        filled = component.filled(lambda text: _fill(text, words))
        fixed = self._file.system.surroundings == "fixed"
        surroundings = fixed_environment(component.env) if fixed else {}
        domain = domain_environment(self._domain(name), self._directory) if component.dds else {}
        own = {**domain, **filled.env, **surroundings}
        plain = {**environment_of_others(), **own}
        env = plain
        if component.is_process:
            env = env | self._python.environment(env, imports=self._program(name) not in self._imports)
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
            number, title = self._domain(name), f"{name}.bridge"
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
            self._processes[name] = self._launcher.start(
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
        pid = str(self._processes[name].pid)
        ready, stop = (
            [word.replace("{pid}", pid) for word in each] for each in (filled.ready.command, filled.stop_command)
        )
        self._commands[name] = _Commands(ready, stop, plain, cwd)
        return self._processes[name]

    def stop(self, name: str) -> str | None:
        """Ask a component to end by itself, by the command `stop`; return what is wrong if it goes on, else None."""
        commands, process = self._commands[name], self._processes[name]
        try:
            asking = self._launcher.start(
                f"{name}.stop", commands.stop, env=commands.env, cwd=commands.cwd, directory=self._directory
            )
        except EnvironmentFaultError as error:
            return f"cannot be executed: {error.message}"
        deadline = time.monotonic() + _STOPPED_WITHIN_S
        asked = self._launcher.wait([asking], timeout=_STOPPED_WITHIN_S)
        if asking.status == 0 and self._launcher.wait([process], timeout=deadline - time.monotonic()):
            return None
        if asking.status:
            return f"ended with status {asking.status}; {last_words(asking)}"
        told = "and the component still runs" if asked else "and has not ended itself"
        return f"was executed {_STOPPED_WITHIN_S:g} s ago, {told}"

    def why_not_ready(self, name: str) -> str | None:
        """Return what `ready.command` of a component says, and execute it again; None once it has ended with 0."""
        check = self._commands[name]
        if not check.ready or (check.process is not None and check.process.status == 0):
            return None
        if check.process is None or not self._launcher.alive(check.process):
            check.told = "" if check.process is None else f" ended with status {check.process.status}"
            if time.monotonic() - check.started >= _CHECKED_EVERY_S:
                check.started = time.monotonic()
                check.process = self._launcher.start(
                    f"{name}.ready", check.ready, env=check.env, cwd=check.cwd, directory=self._directory
                )
        return f"is not ready: {check.ready[0]!r}{check.told or ' has not ended'}"

    def folder_of(self, name: str) -> Path:
        """Return where a component's code is: its working folder."""
        return self._folders[name]

    def _words(self, name: str, endpoint: str, *, segment: str, seed: int, pace: RunPace | None) -> dict[str, str]:
        """Return what stands for each placeholder of a component."""
        component = self._file.components[name]
        words = self._common_words() | {
            "{endpoint}": endpoint,
            "{segment}": segment,
            "{seed}": str(seed),
            "{duration}": f"{pace.duration if pace else 0:g}",
            "{speed}": f"{pace.speed if pace else 1:g}",
        }
        words |= {f"{{param:{one}}}": _as_word(value) for one, value in self._parameters.items()}
        for text in self._file.texts_of(component):
            words |= {word: str(self.free_port(word)) for word in FREE_PORT.findall(text)}
            words |= {"{domain}": str(self._domain(name))} if "{domain}" in text else {}
        copies = {
            f"{{file:{path}}}": self._copy(f"{name}.{number}", path, words)
            for number, path in enumerate(component.files)
        }
        return words | copies

    def _common_words(self) -> dict[str, str]:
        return {
            "{python}": sys.executable,
            "{trial_dir}": str(self._directory),
            "{slot}": str(self._launcher.slot),
        }

    def _copy(self, prefix: str, path: str, words: Mapping[str, str]) -> str:
        """Return the path of a component's copy of a file, in which placeholders are filled in."""
        copy = self._directory / f"{prefix}.{os.path.basename(path)}"
        copy.write_text(_fill(self._file.text_of(path), words), encoding="utf-8")
        return str(copy)

    def execute(self, name: str, command: Sequence[str], *, timeout: float) -> None:
        """Execute a command that belongs to no component, to its end; see `TrialSetup.execute`."""
        words = self._common_words() | {
            word: str(self.free_port(word)) for text in command for word in FREE_PORT.findall(text)
        }
        filled = [_fill(word, words) for word in command]
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

    def _domain(self, name: str) -> int:
        """Return a ROS domain that is reserved until the trial ends: a component's own one if it has a bridge."""
        owner = name if self._file.components[name].dds else ""
        if owner not in self._domains:
            self._domains[owner] = self._reserved.enter_context(free_domains(1))[0]
        return self._domains[owner]

    def free_port(self, word: str) -> int:
        """Return a port of TCP and UDP that was free, for each placeholder its own, the same in all of the trial."""
        while word not in self._ports:
            port = random.SystemRandom().choice(_PORTS)
            with socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp, suppress(OSError):
                tcp.bind(("", port))
                udp.bind(("", port))
                if port not in self._ports.values():
                    self._ports[word] = port
        return self._ports[word]

    def find_inside(self, name: str) -> None:
        """Find the processes of a ready component that are not descendants of riot's, and check `only`.

        Raises:
            ConfigError: The component's command has started no process that matches `only` in riot.toml.
        """
        start, process = self._starts[name], self._processes[name]
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
            found.append(self._processes[name].pid)
            found += self._inside.get(name, ())
            found += [self._bridges[name].pid] if name in self._bridges else []
        return tuple(found)

    def bridge_of(self, name: str) -> ComponentProcess | None:
        """Return the bridge of a component to DDS; None if it has none."""
        return self._bridges.get(name)

    def runs(self, name: str) -> bool:
        """Return whether a component runs, and its bridge if it has one."""
        processes = [self._processes[name], *([self._bridges[name]] if name in self._bridges else [])]
        return all(map(self._launcher.alive, processes))

    def check_way(self, name: str) -> None:
        """Check that the bridge or connection to a component has not ended, which is not a failure of the component.

        Raises:
            EnvironmentFaultError: The bridge or connection has ended.
        """
        start, process, bridge = self._starts[name], self._processes[name], self._bridges.get(name)
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


def last_words(process: ComponentProcess) -> str:
    """Return the end of what a process has written to stderr, as a hint."""
    lines = process.errors().strip().splitlines()
    tail = "\n    ".join(lines[-6:])
    return f"its last words on stderr:\n    {tail}" if lines else "it wrote nothing to stderr"


def _as_word(value: Scalar) -> str:
    """Return a parameter as commands take it: `true` rather than `True`."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _fill(text: str, words: Mapping[str, str]) -> str:
    for word, value in words.items():
        text = text.replace(word, value)
    return text


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
