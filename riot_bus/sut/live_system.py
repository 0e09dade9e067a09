"""The components of a system in virtual time, on segments of their own; they may go on over runs, which costs no start.

Where riot.toml says what brings the system back to its first state, processes stay for the next run after one that has
passed. What fails is executed again at once with processes of its own, and that outcome counts.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Self

from riot_bus.pipeline.runner import Pipeline
from riot_bus.sut.persistent import KEPT
from riot_bus.sut.scarce import held
from riot_bus.sut.stage import TrialSetup
from riot_bus.sut.virtual_time import VirtualTime, single_key
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus.sut.stage import TrialPlace
    from riot_bus.sut.system import RunPace, VirtualClock
    from riot_bus.vocabulary.message import Scalar

__all__ = ["LiveSystem"]

_MOST_RUNS = 100
"""Of one set of processes; a start then costs less than a hundredth of the time."""
_VARYING = ("{seed}", "{duration}", "{speed}")


class LiveSystem:
    """Components that run in virtual time; a context manager.

    Args:
        clock: How the time is told.
        place: Where they run.
        seed: For {seed} in commands.
        pace: For {duration} and {speed}.
        parameters: Values of {param:NAME}, where these are not the nominal ones.
        timeout: Seconds after which a component that is still busy hangs.
        stall: Seconds after which one that takes no messages loses its link.

    Attributes:
        runs: How many runs it has had.
        stage: Where they run.
        time: Their time.
    """

    def __init__(
        self,
        clock: VirtualClock,
        place: TrialPlace,
        *,
        seed: int,
        pace: RunPace,
        parameters: Mapping[str, Scalar],
        timeout: float,
        stall: float,
    ) -> None:
        self.runs = 0
        self.time = VirtualTime(clock, list(place.context.file.components), timeout=timeout)
        self.stage: TrialSetup
        self._clock, self._place, self._stall = clock, place, stall
        self._made_for = seed, pace, dict(parameters)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        context = self._place.context
        with ExitStack() as stack:
            stack.enter_context(held(context.file, list(context.file.components)))
            folder = self._place.directory
            if self.may_go_on:
                folder = Path(tempfile.mkdtemp(prefix=KEPT.format(os.getpid()), dir=folder.parent))
                stack.callback(shutil.rmtree, folder, ignore_errors=True)
            self.stage = stack.enter_context(
                TrialSetup(
                    context,
                    self._place.launcher,
                    folder,
                    segments=(),
                    intercept=["**"],
                    pipeline=Pipeline([self.time], registry=context.registry),
                    stall=self._stall,
                    parameters=self._made_for[2],
                    imports=self._place.imports,
                )
            )
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def may_go_on(self) -> bool:
        """Whether it may have another run: it can be reset, and needs nothing that others wait for."""
        components = self._place.context.file.components.values()
        return (
            self._clock.reset is not None and self.runs < _MOST_RUNS and not any(each.resources for each in components)
        )

    def fits(self, *, seed: int, pace: RunPace, parameters: Mapping[str, Scalar]) -> bool:
        """Return whether its commands are those that a run asks for."""
        stage = self.stage
        if not self.may_go_on or not all(map(stage.launcher.alive, stage.processes.values())):
            return False
        made_for, wanted = self._made_for, (seed, pace, dict(parameters))
        words = [
            word
            for each in self._place.context.file.components.values()
            for word in self._place.context.file.texts_of(each)
        ]
        varies = any(one in word for word in words for one in _VARYING)
        return made_for == wanted if varies else made_for[2] == wanted[2]

    def prepare(self, time: int) -> None:
        """Begin another run, whose first message has this time in nanoseconds; observers come after that."""
        self.time.begin(time)
        self.stage.now = self.time.now
        self.stage.renew()

    def start(self) -> None:
        """Start the components, or reset those that run.

        Raises:
            ConfigError: No component has subscribed to the message that is to reset them.
            EnvironmentFaultError: One does not start.
        """
        names, (seed, pace, _) = list(self._place.context.file.components), self._made_for
        self.runs += 1
        if self.runs == 1:
            for name in names:
                self.stage.start(name, seed=seed, pace=pace)
            self.stage.wait_ready(names)
        elif (reset := self._clock.reset) is not None:
            where = f"{self._place.context.file.path}: system.clock.reset"
            key = single_key(self.stage, reset.topic, where=where)
            message = Message(self.time.now(), key, reset.payload.encode(), encoding=reset.encoding)
            if not self.time.give(self.stage, message):
                raise ConfigError(
                    f"no component has subscribed to {reset.topic!r}",
                    where=where,
                    hint="name a topic that resets them, or leave `reset` out",
                )
