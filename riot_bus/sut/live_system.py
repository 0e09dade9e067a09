"""The components of a system in virtual time, each on a separate segment; see `kept_system`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from riot_bus.pipeline.runner import Pipeline
from riot_bus.sut.kept_system import KeptComponents, not_subscribed
from riot_bus.sut.virtual_time import VirtualTime, single_key
from riot_bus.vocabulary.message import Message

if TYPE_CHECKING:
    from riot_bus.sut.stage import TrialPlace
    from riot_bus.sut.system import VirtualClock

__all__ = ["LiveSystem"]


class LiveSystem(KeptComponents):
    """Components that run in virtual time.

    Args:
        place: Place in which they run.
        clock: Settings of the virtual clock and of the reset.
        timeout: Seconds after which a component that is still busy counts as hanging.
        options: Further arguments of `KeptComponents`.

    Attributes:
        time: Virtual time of the components.
    """

    def __init__(self, place: TrialPlace, clock: VirtualClock, *, timeout: float, **options: Any) -> None:
        names = list(place.context.file.components)
        super().__init__(place, names, reset=clock.reset, timeout=timeout, **options)
        self.time = VirtualTime(clock, names, timeout=timeout)

    def _crossing(self) -> dict[str, Any]:
        pipeline = Pipeline([self.time], registry=self._place.context.registry)
        return {"segments": (), "intercept": ["**"], "pipeline": pipeline}

    def prepare(self, time: int) -> None:
        """Prepare a run whose first message has this time in nanoseconds; call it before observers are set up."""
        self.time.begin(time)
        self.stage.now = self.time.now
        self.stage.renew()

    def start(self) -> None:
        """Start the components, or reset those that run.

        Raises:
            ConfigError: No component has subscribed to the message that is to reset them.
            EnvironmentFaultError: A component does not start, or cannot be reset.
        """
        self.runs += 1
        if self.runs == 1:
            self._start()
        elif (reset := self._reset) is not None:
            where = f"{self._place.context.file.path}: system.clock.reset"
            if reset.topic is None:
                self.stage.execute("reset", reset.command, timeout=self._timeout)
                return
            key = single_key(self.stage, reset.topic, where=where)
            message = Message(self.time.now(), key, reset.payload.encode(), encoding=reset.encoding)
            if not self.time.give(self.stage, message):
                raise not_subscribed(reset.topic, where=where)
