"""The setup of one trial: its network, its components, their observation, and the view that monitors judge."""

from __future__ import annotations

import os
import signal
import time
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self

from riot_bus.monitors.model import NO_SIGNS, ComponentView, Signs, TrialView
from riot_bus.processes.activity import out_of_memory_kills
from riot_bus.trial.network import KeptNetwork, TrialNetwork
from riot_bus.trial.observation import Observation
from riot_bus.trial.processes import TrialProcesses
from riot_bus.trial.readiness import Readiness
from riot_bus.vocabulary.errors import EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Mapping, MutableMapping, MutableSequence, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    from riot_bus.processes.launcher import ComponentProcess, Launcher
    from riot_bus.system.system_file import RunPace
    from riot_bus.trial.context import Context
    from riot_bus.vocabulary.message import Scalar


@dataclass(frozen=True, slots=True)
class TrialPlace:
    """The place of a trial: system, launcher, folder, and what is kept between trials.

    Attributes:
        directory: Folder in which files may be left.
        imports: Modules that Python components import, by program (see `TrialProcesses`); trials fill it.
        kept: Systems that are kept over trials.
        network: Segments that stay open between trials.
    """

    LEFT = "left"
    """Name in the folder of what a trial is asked to leave: a folder of evidence, or a recording."""

    context: Context
    launcher: Launcher
    directory: Path
    imports: MutableMapping[str, Sequence[str]]
    kept: MutableSequence[AbstractContextManager[object]] = field(default_factory=list)
    network: KeptNetwork = field(default_factory=KeptNetwork)

    @property
    def left(self) -> Path:
        """Path of the evidence or recording that a trial is asked for."""
        return self.directory / self.LEFT

    def setup(self, *, context: Context | None = None, directory: Path | None = None, **options: Any) -> TrialSetup:
        """Return a setup in this place, or with another context or folder; takes the arguments of `TrialSetup`."""
        given: dict[str, Any] = {"imports": self.imports, "kept": self.network, **options}
        return TrialSetup(context or self.context, self.launcher, directory or self.directory, **given)


class TrialSetup:
    """The parts of one trial; a context manager that leaves nothing behind.

    Attributes:
        begun: Start of the trial, in seconds of the monotonic clock.
    """

    def __init__(
        self,
        context: Context,
        launcher: Launcher,
        directory: Path,
        *,
        parameters: Mapping[str, Scalar] | None = None,
        imports: MutableMapping[str, Sequence[str]] | None = None,
        **options: Any,
    ) -> None:
        self.context = context
        self.network = TrialNetwork(context, **options)
        self.processes = TrialProcesses(context, launcher, directory, imports=imports, parameters=parameters)
        self.observation = Observation(self.processes, self.network)
        self.readiness = Readiness(context, launcher, self.network, self.processes, self.observation)
        self.begun, self._begin, self._killed = time.monotonic(), time.time_ns(), out_of_memory_kills()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(self.network)
            stack.callback(self.readiness.close)
            stack.callback(self.observation.close)
            stack.enter_context(self.processes)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.__exit__(*error)

    def start(
        self, name: str, *, seed: int, pace: RunPace | None = None, before: Sequence[str] = ()
    ) -> ComponentProcess:
        """Start a component on its segment; see `TrialProcesses.start`."""
        self.readiness.expect(name)
        segment = self.network.segment_of(name)
        return self.processes.start(
            name, self.network.endpoint(segment), segment=segment, seed=seed, pace=pace, before=before
        )

    def restart(self) -> None:
        """Begin another run of the same processes, and discard what was observed in the last one."""
        self.begun, self._begin = time.monotonic(), self.network.now()
        self.network.restart()
        self.observation.restart()
        for process in self.processes.started.values():
            for path in (process.stdout, process.stderr):
                os.truncate(path, 0)

    def view(
        self, names: Sequence[str], *, settled: bool, waited: float, signs: Mapping[str, Signs] | None = None
    ) -> TrialView:
        """Return what the monitors judge, for these components.

        Args:
            names: Names of the components.
            settled: False when they were still busy at the deadline.
            waited: That deadline, seconds.
            signs: Differences of each component from nominal trials.
        """
        views = [self.component_view(name, (signs or {}).get(name, NO_SIGNS)) for name in names]
        network = self.network
        losses = network.bus.losses
        if settled and (late := losses.reasons.get("observer too slow")):  # else it publishes without an end
            hint = "run fewer trials at once (--jobs), or stop what else runs on this machine"
            raise EnvironmentFaultError(f"{late} outputs came faster than they could be taken in", hint=hint)
        broken = {link.segment for link in losses.links if link.reason == "stalled"}
        return TrialView(
            views,
            settled,
            waited,
            self.context.registry,
            tuple(network.outputs),
            self._begin,
            network.now(),
            [name for name in names if network.segment_of(name) in broken],
            tuple(network.inputs),
        )

    def component_view(self, name: str, signs: Signs = NO_SIGNS) -> ComponentView:
        """Return what the monitors judge, for one component.

        Raises:
            EnvironmentFaultError: What ended it was this machine.
        """
        component, process = self.context.file.components[name], self.processes.started[name]
        alive = self.processes.alive([name])
        self.processes.check_way(name)
        if process.status == -signal.SIGKILL and process.excess is None and out_of_memory_kills() > self._killed:
            hint = "run fewer trials at once (--jobs), or write limits with less memory"
            raise EnvironmentFaultError(f"the kernel has ended {name!r}: the machine has no memory left", hint=hint)
        if component.attach is not None and not alive:  # its status is not known
            signs = replace(signs, ended="its process has ended")
        return ComponentView(
            name,
            process.status,
            process.errors(),
            self.processes.folder_of(name),
            component.tracebacks == "fail",
            printed=process.printed(),
            stack=process.stack,
            resources=tuple(self.observation.samples(name)),
            signs=signs,
            excess=self.processes.excess(name),
            unread=process.unread,
        )
