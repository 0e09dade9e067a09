"""Components of a system that are kept over several runs if riot.toml says how to reset them, which saves starts.

After a run that has passed, the processes stay for the next run. A case that fails is executed again at once with fresh
processes, and that outcome counts.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from abc import ABC, abstractmethod
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from riot_bus.pipeline.runner import Pipeline
from riot_bus.sut.persistent import KEPT
from riot_bus.sut.scarce import held
from riot_bus.sut.stage import TrialSetup
from riot_bus.sut.virtual_time import single_key
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.injection import PARAMETERS
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.session import includes

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from riot_bus.sut.stage import TrialPlace, Watch
    from riot_bus.sut.system import Reset, RunPace, SystemFile
    from riot_bus.vocabulary.message import Scalar
    from riot_bus.vocabulary.trial import TestCase

__all__ = ["KeptComponents", "KeptSystem", "not_subscribed"]

_MOST_RUNS = 100
"""Largest number of runs of one set of processes, so that a start costs less than a hundredth of the time."""
_VARYING = ("{seed}", "{duration}", "{speed}")
_RESET_WINDOW = 0.1
"""Window of rest after a reset, in seconds; on a loaded machine, a reset may take ten such windows to arrive."""
_BLOCK = Qos(congestion="block")


class KeptComponents(ABC):
    """Components that may be kept over several runs; a context manager.

    Args:
        place: Place in which they run.
        names: Names of the components.
        reset: Message or command that resets them to their first state; None if nothing does.
        seed: Value of {seed} in commands.
        pace: Values of {duration} and {speed} in commands.
        parameters: Values of {param:NAME} that differ from the nominal ones.
        timeout: Seconds after which a component that is still busy counts as hanging.
        stall: Seconds after which a component that takes no messages loses its link.

    Attributes:
        runs: Number of runs so far.
        stage: Stage on which they run.
    """

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
        self.stage: TrialSetup
        self._place, self._names, self._reset = place, list(names), reset
        self._made_for = seed, pace, dict(parameters)
        self._timeout, self._stall = timeout, stall
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        context = self._place.context
        with ExitStack() as stack:
            stack.enter_context(held(context.file, self._names))
            folder = self._place.directory
            if self.may_go_on:
                folder = Path(tempfile.mkdtemp(prefix=KEPT.format(os.getpid()), dir=folder.parent))
                stack.callback(shutil.rmtree, folder, ignore_errors=True)
            self.stage = stack.enter_context(
                TrialSetup(
                    context,
                    self._place.launcher,
                    folder,
                    stall=self._stall,
                    parameters=self._made_for[2],
                    imports=self._place.imports,
                    network=self._place.network,
                    **self._crossing(),
                )
            )
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @abstractmethod
    def _crossing(self) -> dict[str, Any]:
        """Return the segments, the intercepted keys and the pipeline, as arguments of `TrialSetup`."""

    @property
    def may_go_on(self) -> bool:
        """Whether another run is possible: they can be reset, and hold no limited resource that others wait for."""
        components = self._place.context.file.components
        free = not any(components[name].resources or components[name].attach for name in self._names)
        return self._reset is not None and self.runs < _MOST_RUNS and free

    def fits(self, *, seed: int, pace: RunPace, parameters: Mapping[str, Scalar]) -> bool:
        """Return whether all components run, another run is possible, and it needs the same commands."""
        stage, file = self.stage, self._place.context.file
        if not self.may_go_on or not all(stage.launcher.alive(stage.processes[name]) for name in self._names):
            return False
        made_for, wanted = self._made_for, (seed, pace, dict(parameters))
        words = [word for name in self._names for word in file.texts_of(file.components[name])]
        varies = any(one in word for word in words for one in _VARYING)
        return made_for == wanted if varies else made_for[2] == wanted[2]

    def _start(self) -> None:
        """Start the components."""
        seed, pace, _ = self._made_for
        for name in self._names:
            self.stage.start(name, seed=seed, pace=pace)
        self.stage.wait_ready(self._names)


class KeptSystem(KeptComponents):
    """The components of a system in successive runs in real time; takes the arguments of `KeptComponents`."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._observers: dict[tuple[str, str], list[Callable[[Message], None]]] = {}

    def _crossing(self) -> dict[str, Any]:
        context = self._place.context
        # A log is changed before it is played; played to a segment with cut keys, its messages would arrive twice.
        driven = any(component.external for component in context.file.components.values())
        return {
            "segments": context.file.system.segments,
            "intercept": context.topics(*context.file.external.topics) if driven else [],
            "pipeline": Pipeline([], registry=context.registry),
        }

    @staticmethod
    def can_carry(file: SystemFile, case: TestCase) -> bool:
        """Return whether a case can be carried out so: all topics that it injects into are cut between segments."""
        if case.messages:  # not with external components: played messages would bypass what is cut for these
            return not any(component.external for component in file.components.values())
        changed = {each.topic for each in case.injections if each.topic != PARAMETERS}
        inside, outside = (
            {file.segment_of(one) for one in file.components.values() if one.external is way} for way in (False, True)
        )
        return not inside & outside and changed <= set(file.external.topics)

    def begin(self, interceptors: Sequence[object]) -> None:
        """Prepare a run: reset the components if they run already, and remove their observers.

        Args:
            interceptors: Interceptors of the messages from outside from now on.

        Raises:
            ConfigError: No component has subscribed to the message that is to reset them.
            EnvironmentFaultError: The components cannot be reset.
        """
        stage, self.runs = self.stage, self.runs + 1
        if self.runs > 1:
            for observers in self._observers.values():
                observers.clear()
            self._bring_back()
            stage.renew()
        stage.bus.set_interceptors(interceptors)
        stage.bus.restart()

    def start(self) -> None:
        """Start the components in the first run, once their observers are set up."""
        if self.runs == 1:
            self._start()

    def watching(self, segment: str) -> Watch:
        """Return a function that observes a segment until the next run."""

        def watch(expression: str, take: Callable[[Message], None]) -> None:
            known = self._observers.get((segment, expression))
            if known is None:
                known = self._observers[segment, expression] = []
                self.stage.bus.subscribe(segment, expression, partial(_tell, known))
            known.append(take)

        return watch

    def _bring_back(self) -> None:
        reset, stage = self._reset, self.stage
        assert reset is not None
        where, before = f"{self._place.context.file.path}: system.reset", stage.activity(self._names)
        if reset.topic is None:
            stage.execute("reset", reset.command, timeout=self._timeout)
        else:
            key = single_key(stage, reset.topic, where=where)
            message = Message(time.time_ns(), key, reset.payload.encode(), encoding=reset.encoding, qos=_BLOCK)
            cut = any(includes(text, key) for text in stage.bus.intercepted)
            reached = (stage.bus.deliver(name, message) for name in stage.bus.sessions)
            if not (any(list(reached)) if cut else any(reached)):  # if not cut, it is routed to the others
                raise not_subscribed(reset.topic, where=where)
        if not stage.settle(self._names, window=_RESET_WINDOW, timeout=self._timeout, idle=stage.idle, since=before):
            raise EnvironmentFaultError(f"components are still busy {self._timeout:g} s after their reset", where=where)
        stage.bus.drain(self._timeout)


def _tell(observers: Sequence[Callable[[Message], None]], message: Message) -> None:
    for observe in observers:
        observe(message)


def not_subscribed(topic: str, *, where: str) -> ConfigError:
    """Return the error of a reset that reaches nobody."""
    return ConfigError(
        f"no component has subscribed to {topic!r}",
        where=where,
        hint="name a topic that resets them, or leave `reset` out",
    )
