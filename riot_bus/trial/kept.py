"""Processes that are kept over several trials, which saves starts: how they are held, reset and ended.

They stay in `TrialPlace.kept` after a trial that has passed. A case that fails is executed again at once with fresh
ones, and that outcome counts, so that no failure depends on earlier cases.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from abc import ABC, abstractmethod
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from riot_bus.trial.virtual_time import single_key
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message, Qos

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.system.system_file import Reset
    from riot_bus.trial.stage import TrialPlace, TrialSetup

FOLDER_PREFIX = "persistent-{}-"
"""Prefix of the folders of kept processes, with the process id of the worker."""
MOST_TRIALS = 100
"""Largest number of trials of one set of processes, so that a start costs less than a hundredth of the time."""


class KeptSetup(ABC):
    """A setup whose processes may serve several trials; a context manager.

    Attributes:
        stage: The setup; available once entered.
    """

    stage: TrialSetup

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self.stage = self._open(stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.__exit__(*error)

    @abstractmethod
    def _open(self, stack: ExitStack) -> TrialSetup:
        """Reserve the resources that the processes need and open their setup; `stack` undoes this at the end."""


def kept_folder(place: TrialPlace, stack: ExitStack) -> Path:
    """Create a folder that lasts longer than that of the present trial; `stack` removes it."""
    folder = Path(tempfile.mkdtemp(prefix=FOLDER_PREFIX.format(os.getpid()), dir=place.directory.parent))
    stack.callback(shutil.rmtree, folder, ignore_errors=True)
    return folder


def end_kept(place: TrialPlace) -> None:
    """End all processes that are kept over trials, since the next trial needs the place for itself."""
    while place.kept:
        place.kept.pop().__exit__(None, None, None)


def reset_components(
    stage: TrialSetup, reset: Reset, publish: Callable[[Message], bool], *, where: str, timeout: float
) -> None:
    """Reset components to their first state, by the command or by the message that riot.toml names.

    Args:
        stage: Setup on which the components run.
        reset: Command or message.
        publish: Function that publishes the message and returns whether a component has subscribed to it.
        where: Place of `reset` in riot.toml, for errors.
        timeout: Time limit of the command, in seconds.

    Raises:
        ConfigError: The command fails, or no component has subscribed to the message.
        EnvironmentFaultError: The command cannot be executed, or takes too long.
    """
    if reset.topic is None:
        stage.execute("reset", reset.command, timeout=timeout)
        return
    key = single_key(stage, reset.topic, where=where)
    qos = Qos(congestion="block")
    if not publish(Message(stage.now(), key, reset.payload.encode(), encoding=reset.encoding, qos=qos)):
        raise not_subscribed(reset.topic, where=where)


def not_subscribed(topic: str, *, where: str) -> ConfigError:
    """Return the error of a reset message that no component receives."""
    hint = "name a topic that resets them, or leave `reset` out"
    return ConfigError(f"no component has subscribed to {topic!r}", where=where, hint=hint)
