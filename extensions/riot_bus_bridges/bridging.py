"""Base of bridges, which connect other middleware to a segment.

A bridge is part of an adapter package. Its command is a function for typer, found by the entry points
`riot_bus.bridges`; the attribute `obj` of its `typer.Context` is the host, `riot_bus_bridges.BridgeHost`. Parameters
called `system`, `cfg` and `form` get riot's own options; a parameter whose type is a dataclass gets the options that
its `Flag`s declare.
"""

import logging
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

from riot_bus.types.port import BridgedLink
from riot_bus.vocabulary.errors import RiotError
from riot_bus.vocabulary.flags import Flag

_LOG = logging.getLogger(__name__)


class Bridge(ABC):
    """A bridge of an adapter: a context manager that starts and ends it, once.

    Args:
        warn: Function that prints a line about a problem; called on any thread.

    Attributes:
        failure: Error that ended the bridge by itself.
        ended: Event that is set as soon as the bridge has to end.
        problems: Lines about problems, each of them once, the oldest first.
        listens: Endpoints, such as `udp/0.0.0.0:14550`, at which others reach its links without Zenoh.
    """

    listens: Sequence[str] = ()

    def __init__(self, *, warn: Callable[[str], None] = _LOG.warning) -> None:
        self.failure: RiotError | None = None
        self.ended = threading.Event()
        self.problems: dict[str, None] = {}
        self._warn = warn
        self._stack = ExitStack()

    @abstractmethod
    def open(self, stack: ExitStack) -> None:
        """Start the bridge; register what ends it in `stack`, which is also closed if the start fails."""

    @abstractmethod
    def status(self) -> dict[str, Any]:
        """Return the current state, as JSON values."""

    @abstractmethod
    def ready(self) -> str:
        """Return a line that says what is bridged."""

    @abstractmethod
    def summary(self) -> Sequence[str]:
        """Return lines that say what crossed the bridge."""

    def words(self) -> Mapping[str, str]:
        """Return the values of `{WORD}` in the command of a program behind the bridge, by word."""
        return {}

    def wait(self, timeout: float) -> bool:
        """Wait until the bridge has to end; return whether it has to."""
        return self.ended.wait(timeout)

    def stop(self) -> None:
        """End the bridge soon; also usable in signal handlers."""
        self.ended.set()

    def report_problem(self, line: str) -> None:
        """Warn of a problem, unless it has been reported before."""
        if line not in self.problems and len(self.problems) < 1000:  # peers can make up any number
            self.problems[line] = None
            with suppress(OSError):  # the reader of the warnings is gone; bridging continues
                self._warn(f"warning: {line}")

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self.open(stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()


@dataclass(frozen=True, slots=True)
class OwnRouter:
    """Options of the router in a bridge's own process, as written on the command line.

    Attributes:
        system: Path of riot.toml; None for the one in the working folder, if there is one.
        definitions: Files that define message types.
        adapters: Adapters that replace those of the same name, with options, as `mavlink:dialect=ardupilotmega`.
        carried: Key expressions that are also intercepted, since the bridge carries them.
    """

    system: Path | None = None
    segments: Annotated[
        Sequence[str],
        Flag(
            "Own router (without --segment and --endpoint): a segment and where it listens; repeatable. "
            "[default: as of riot router]",
            "--listen",
            "NAME=ENDPOINT[,...]",
        ),
    ] = ()
    intercept: Annotated[
        Sequence[str],
        Flag("Own router: what goes through interceptors, such as COMMAND_LONG.", metavar="KEYEXPR"),
    ] = ()
    interceptors: Annotated[
        Sequence[str],
        Flag(
            "Own router: interceptor of what --intercept names, as for riot router; repeatable.",
            "--interceptor",
            "'NAME key=value ...'|FILE.py[:NAME]",
        ),
    ] = ()
    inject: Annotated[Path | None, Flag("Own router: injections; their topics are intercepted.", "", "PLAN.toml")] = (
        None
    )
    record: Annotated[Path | None, Flag("Own router: record all that passes.", "", "OUT.mcap")] = None
    definitions: Sequence[Path] = ()
    adapters: Sequence[str] = ()
    carried: Sequence[str] = ()


class LinkedBridge(Bridge):
    """A bridge that lists its links, so that it can run in one process with a router."""

    @abstractmethod
    def links(self) -> Collection[BridgedLink]:
        """Return the current links; called on any thread."""
