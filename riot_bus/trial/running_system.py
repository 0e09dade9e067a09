"""The components of a system in one or several runs: in real time, or in virtual time with a segment for each.

Systems that can be reset stay in `TrialPlace.kept` after a run that has passed, which saves starts. A case that fails
with one is executed again at once with a new one, and that outcome counts, so no failure depends on earlier runs.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from abc import ABC, abstractmethod
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from riot_bus.pipeline.runner import Pipeline
from riot_bus.trial.scarce import held
from riot_bus.trial.virtual_time import VirtualTime, single_key
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.injection import PARAMETERS
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.session import includes

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.system.system_file import Reset, RunPace, SystemFile, VirtualClock
    from riot_bus.trial.network import Subscribe
    from riot_bus.trial.setup import TrialPlace, TrialSetup
    from riot_bus.vocabulary.message import Scalar
    from riot_bus.vocabulary.trial import TestCase

FOLDER_PREFIX = "kept-{}-"
"""Prefix of the folders of kept systems, with the process id of the worker."""
_MOST_RUNS = 100
"""Largest number of runs of one set of processes, so that a start costs less than a hundredth of the time."""
_VARYING = ("{seed}", "{duration}", "{speed}")


class RunningSystem(ABC):
    """The components of a system in successive runs; a context manager.

    Args:
        reset: Message or command that resets them to their first state; None if they serve one run only.
        timeout: Seconds after which a component that is still busy counts as hanging.
        stall: Seconds after which a component that takes no messages loses its link.
    """

    setup: TrialSetup

    def __init__(
        self,
        place: TrialPlace,
        names: Sequence[str],
        *,
        reset: Reset | None,
        seed: int,
        pace: RunPace,
        parameters: Mapping[str, Scalar],
        timeout: float,
        stall: float,
    ) -> None:
        self.runs = 0
        self._place, self._names, self._reset = place, list(names), reset
        self._made_for = seed, pace, dict(parameters)
        self._timeout, self._stall = timeout, stall

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(held(self._place.context.file, self._reserved()))
            self.setup = stack.enter_context(
                self._place.setup(
                    directory=self._make_folder(stack) if self.may_go_on else None,
                    stall=self._stall,
                    parameters=self._made_for[2],
                    **self._crossing(),
                )
            )
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.__exit__(*error)

    def _make_folder(self, stack: ExitStack) -> Path:
        """Create a folder that lasts longer than that of the present run; `stack` removes it."""
        prefix = FOLDER_PREFIX.format(os.getpid())
        folder = Path(tempfile.mkdtemp(prefix=prefix, dir=self._place.directory.parent))
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        return folder

    def _reserved(self) -> Sequence[str]:
        """Return the components whose limited resources are reserved as long as the setup is open."""
        return self._names

    @abstractmethod
    def _crossing(self) -> dict[str, Any]:
        """Return the segments, the intercepted keys and the pipeline, as arguments of `TrialSetup`."""

    @abstractmethod
    def begin(self, interceptors: Sequence[object], *, time: int) -> None:
        """Begin a run: discard what was observed so far, and remove all observers.

        Args:
            interceptors: Interceptors of the messages from outside from now on.
            time: Time of the first message of the run in nanoseconds, if it is in virtual time.
        """

    @abstractmethod
    def watching(self, segment: str) -> Subscribe:
        """Return a function that observes a segment until the next run."""

    @abstractmethod
    def start(self) -> None:
        """Start the components, or reset those that run, once their observers are set up."""

    @property
    def may_go_on(self) -> bool:
        """Whether another run is possible: they can be reset, and hold no limited resource that others wait for."""
        components = self._place.context.file.components
        free = not any(components[name].resources or components[name].attach for name in self._names)
        return self._reset is not None and self.runs < _MOST_RUNS and free

    def fits(self, *, seed: int, pace: RunPace, parameters: Mapping[str, Scalar]) -> bool:
        """Return whether all components run, another run is possible, and it needs the same commands."""
        file = self._place.context.file
        if not self.may_go_on or not self.setup.processes.alive(self._names):
            return False
        made_for, wanted = self._made_for, (seed, pace, dict(parameters))
        words = [word for name in self._names for word in file.texts_of(file.components[name])]
        varies = any(one in word for word in words for one in _VARYING)
        return made_for == wanted if varies else made_for[2] == wanted[2]

    def _start(self) -> None:
        """Start the components."""
        seed, pace, _ = self._made_for
        for name in self._names:
            self.setup.start(name, seed=seed, pace=pace)
        self.setup.readiness.wait_ready(self._names)

    def _reset_components(self, reset: Reset, publish: Callable[[Message], bool], *, where: str) -> None:
        """Reset components to their first state, by the command or by the message that riot.toml names.

        Raises:
            ConfigError: The command fails, or no component has subscribed to the message.
            EnvironmentFaultError: The command cannot be executed, or takes too long.
        """
        where = f"{self._place.context.file.path}: {where}"
        if reset.topic is None:
            self.setup.processes.execute("reset", reset.command, timeout=self._timeout)
            return
        key, now = single_key(self._place.context, reset.topic, where=where), self.setup.network.now()
        message = Message(now, key, reset.payload.encode(), encoding=reset.encoding, qos=Qos(congestion="block"))
        if not publish(message):
            hint = "name a topic that resets them, or leave `reset` out"
            raise ConfigError(f"no component has subscribed to {reset.topic!r}", where=where, hint=hint)


class RealTimeSystem(RunningSystem):
    """Components that run in real time.

    Args:
        drivers: Names of the external components that drive a run.
        injected: Topics that injections change.

    Attributes:
        intercepted: Topics that are cut between segments: those of injections or, where another run is possible, all
            external ones.
    """

    def __init__(
        self, place: TrialPlace, names: Sequence[str], drivers: Sequence[str], injected: Sequence[str], **options: Any
    ) -> None:
        super().__init__(place, names, **options)
        self._drivers = drivers
        self._observers: dict[tuple[str, str], list[Callable[[Message], None]]] = {}
        # A log is changed before it is played; played to a segment with cut keys, its messages would arrive twice.
        driven = any(component.external for component in place.context.file.components.values())
        every = place.context.file.external.topics if driven else ()
        self.intercepted: Sequence[str] = every if self.may_go_on else injected

    def _reserved(self) -> Sequence[str]:
        return self._names if self.may_go_on else [*self._names, *self._drivers]

    def _crossing(self) -> dict[str, Any]:
        context = self._place.context
        return {
            "segments": context.file.system.segments,
            "intercept": context.topics(*self.intercepted),
            "pipeline": Pipeline([], registry=context.registry),
            "attach": [*self._names, *self._drivers],
        }

    def begin(self, interceptors: Sequence[object], *, time: int) -> None:
        """Begin a run; reset the components if they run already.

        Raises:
            ConfigError: No component has subscribed to the message that is to reset them.
            EnvironmentFaultError: The components cannot be reset.
        """
        bus, self.runs = self.setup.network.bus, self.runs + 1
        if self.runs > 1:
            for observers in self._observers.values():
                observers.clear()
            self._bring_back()
            self.setup.restart()
        bus.set_interceptors(interceptors)
        bus.restart()

    def start(self) -> None:
        """Start the components in the first run."""
        if self.runs == 1:
            self._start()

    def watching(self, segment: str) -> Subscribe:
        """Return a function that observes a segment until the next run."""

        def watch(expression: str, take: Callable[[Message], None]) -> None:
            known = self._observers.get((segment, expression))
            if known is None:
                known = self._observers[segment, expression] = []
                self.setup.network.bus.subscribe(segment, expression, partial(_tell, known))
            known.append(take)

        return watch

    def _bring_back(self) -> None:
        bus, observation = self.setup.network.bus, self.setup.observation
        assert self._reset is not None
        before = observation.activity(self._names)

        def publish(message: Message) -> bool:
            cut = any(includes(text, message.key) for text in bus.intercepted)
            reached = (bus.deliver(name, message) for name in bus.sessions)
            return any(list(reached)) if cut else any(reached)  # if not cut, it is routed to the others

        self._reset_components(self._reset, publish, where="system.reset")
        if not observation.settle(self._names, window=0.1, timeout=self._timeout, idle=observation.idle, since=before):
            where = f"{self._place.context.file.path}: system.reset"
            raise EnvironmentFaultError(f"components are still busy {self._timeout:g} s after their reset", where=where)
        bus.drain(self._timeout)


class VirtualTimeSystem(RunningSystem):
    """Components that run in virtual time, each on a separate segment.

    Args:
        timeout: Seconds after which a component that is still busy counts as hanging.
    """

    intercepted: Sequence[str] = ()

    def __init__(self, place: TrialPlace, clock: VirtualClock, *, timeout: float, **options: Any) -> None:
        names = list(place.context.file.components)
        super().__init__(place, names, reset=clock.reset, timeout=timeout, **options)
        self.time = VirtualTime(clock, names, timeout=timeout)

    def __enter__(self) -> Self:
        super().__enter__()
        self.time.setup = self.setup
        return self

    def _crossing(self) -> dict[str, Any]:
        pipeline = Pipeline([self.time], registry=self._place.context.registry)
        return {"segments": (), "intercept": ["**"], "pipeline": pipeline}

    def begin(self, interceptors: Sequence[object], *, time: int) -> None:
        """Begin a run at a virtual time; messages come from a log alone, which was changed before."""
        self.time.begin(time)
        self.setup.network.now = self.time.now
        self.setup.restart()

    def watching(self, segment: str) -> Subscribe:
        """Return a function that observes the messages of all segments until the next run."""
        matches = self._place.context.registry.matches

        def watch(expression: str, take: Callable[[Message], None]) -> None:
            self.time.observers.append(lambda one: take(one) if matches(expression, one.key) else None)

        return watch

    def start(self) -> None:
        """Start the components, or reset those that run.

        Raises:
            ConfigError: No component has subscribed to the message that is to reset them.
            EnvironmentFaultError: A component does not start, or cannot be reset.
        """
        self.runs += 1
        if self.runs == 1:
            self._start()
        elif self._reset is not None:
            self._reset_components(self._reset, self.time.give, where="system.clock.reset")


def end_kept(place: TrialPlace) -> None:
    """End all systems that are kept over trials, since the next trial needs the place for itself."""
    while place.kept:
        place.kept.pop().__exit__(None, None, None)


def can_be_kept(file: SystemFile, case: TestCase) -> bool:
    """Return whether a case can be carried out in real time by components that are kept for it.

    All topics that it injects into have to be cut between segments.
    """
    if case.messages:  # not with external components: played messages would bypass what is cut for these
        return not any(component.external for component in file.components.values())
    changed = {each.topic for each in case.injections if each.topic != PARAMETERS}
    return not file.shared_segments() and changed <= set(file.external.topics)


def _tell(observers: Sequence[Callable[[Message], None]], message: Message) -> None:
    for observe in observers:
        observe(message)
