"""Processes and segments that are kept over several trials, and how processes are held, reset and ended.

Segments stay open between trials, since opening, joining and closing them took a third of a short trial. Processes
stay in `TrialPlace.kept` after a trial that has passed. A case that fails is executed again at once with fresh ones,
and that outcome counts, so that no failure depends on earlier cases.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from abc import ABC, abstractmethod
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from riot_bus.sut.virtual_time import single_key
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.network import Network
from riot_bus.zenoh.session import canonical, release, wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import zenoh

    from riot_bus.sut.stage import TrialPlace, TrialSetup
    from riot_bus.sut.system import Reset

__all__ = [
    "FOLDER_PREFIX",
    "MOST_TRIALS",
    "KeptNetwork",
    "KeptSetup",
    "end_kept",
    "kept_folder",
    "not_subscribed",
    "reset_components",
]

FOLDER_PREFIX = "persistent-{}-"
"""Prefix of the folders of kept processes, with the process id of the worker."""
MOST_TRIALS = 100
"""Largest number of trials of one set of processes, so that a start costs less than a hundredth of the time."""
_LEAVE_S = 2.0
"""Processes that have ended leave at once; after this time, even on a loaded machine, a new network is certain."""


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


class _Kind(NamedTuple):
    """The names of segments, the intercepted key expressions, and the longest wait of a publication, in seconds."""

    segments: tuple[str, ...]
    cut: tuple[str, ...]
    wait_before_close_s: float


class KeptNetwork:
    """At most one network on free ports that is free for the next trial; trials that differ get new ones."""

    def __init__(self) -> None:
        self._free: tuple[_Kind, Network] | None = None
        self._lent: dict[Network, _Kind] = {}

    def take(self, segments: Sequence[str], cut: Sequence[str], *, wait_before_close_s: float) -> Network:
        """Return a network for one trial: the free one if it is of this kind and empty, else one to be opened.

        Args:
            segments: Names of the segments.
            cut: Key expressions that will be intercepted.
            wait_before_close_s: Longest wait of a publication for a slow receiver, in seconds.
        """
        kind, free = _Kind(tuple(segments), tuple(canonical(cut)), wait_before_close_s), self._free
        self._free = None
        if free is not None and free[0] == kind and wait_until(lambda: _is_empty(free[1]), _LEAVE_S):
            network = free[1]
        else:
            if free is not None:
                free[1].close()
            anywhere = dict.fromkeys(segments, ("tcp/127.0.0.1:0",))
            network = Network(anywhere, wait_before_close_s=wait_before_close_s)
        self._lent[network] = kind
        return network

    def give_back(self, network: Network, *, usable: bool) -> None:
        """Keep a network for the next trial, or close it.

        Args:
            network: A network from `take`.
            usable: Whether all went well with it.
        """
        kind = self._lent.pop(network)
        if usable:
            self.close()
            self._free = kind, network
        else:
            network.close()

    def close(self) -> None:
        """Close the free network, if there is one."""
        free, self._free = self._free, None
        if free is not None:
            free[1].close()


def _is_empty(network: Network) -> bool:
    """Return whether no component is connected, and no segment still knows of a subscription of an earlier one."""
    ours = network.linked() | {segment.zid for segment in network.segments.values()}
    for segment in network.segments.values():
        if not segment.peers() <= ours:
            return False
    for segment in network.segments.values():
        segment.flush(ours - {segment.zid})
    return not any(map(_is_heard, network.sessions.values()))


def _is_heard(session: zenoh.Session) -> bool:
    """Return whether any other session, here or in another segment, would receive messages of some key."""
    publisher = session.declare_publisher("**", allowed_destination=library_of(session).Locality.REMOTE)
    try:
        return bool(getattr(publisher.matching_status, "matching", True))
    finally:
        release(publisher)
