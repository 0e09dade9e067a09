"""What joins other middleware to a segment: what a bridge is, and what `riot bridge NAME` gives to its command.

A bridge is an adapter package's. Its command is a function that typer can read, found by the entry points
`riot_bus.bridges`; the attribute `obj` of its `typer.Context` is a `BridgeHost`. Parameters called `system`, `cfg` and
`form` get riot's own options.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, Self

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    from riot_bus.vocabulary.errors import RiotError

__all__ = ["Bridge", "BridgeHost", "BridgedLink", "LinkedBridge", "OwnRouter"]


@dataclass(frozen=True, slots=True)
class BridgedLink:
    """A link of a bridge in the router's own process: to the bus, it is what is at its other end.

    Attributes:
        segment: Name of its segment.
        name: Its name.
        addresses: Where its other ends are.
        publishes: Keys of what came over it, and by which of the systems behind it.
        subscribes: Key expression of what can go out over it; empty if nothing can.
    """

    segment: str
    name: str
    addresses: tuple[str, ...] = ()
    publishes: Mapping[str, str] = field(default_factory=dict)
    subscribes: str = ""


class Bridge(Protocol):
    """What adapters bridge with: a context manager that starts and ends it."""

    @property
    def failure(self) -> RiotError | None:
        """Why it has ended by itself."""

    def wait(self, timeout: float) -> bool:
        """Wait until it is to end; return whether it is."""

    def stop(self) -> None:
        """End soon."""

    def status(self) -> dict[str, Any]:
        """Return what is going on, as JSON values."""

    def ready(self) -> str:
        """Return a line that says what is bridged."""

    def summary(self) -> Sequence[str]:
        """Return lines that say what crossed."""

    def words(self) -> Mapping[str, str]:
        """Return what stands for `{WORD}` in the command of a program behind it."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *error: object) -> None: ...


@dataclass(frozen=True, slots=True)
class OwnRouter:
    """What the router in a bridge's own process is to do, as written on the command line.

    Attributes:
        system: riot.toml; None for the one in the working folder, if there is one.
        listen: `NAME=ENDPOINT[,...]`, segments; none for those of riot.toml or of `riot router`.
        intercept: Key expressions of what goes through interceptors.
        interceptors: As of `riot router`.
        inject: An injection plan.
        record: A log of all that passes.
        definitions: Files that define message types.
        adapters: Take the place of those of the same name, with options, as `mavlink:dialect=ardupilotmega`.
        carried: Key expressions that are intercepted besides, since the bridge carries them.
    """

    system: Path | None = None
    listen: Sequence[str] = ()
    intercept: Sequence[str] = ()
    interceptors: Sequence[str] = ()
    inject: Path | None = None
    record: Path | None = None
    definitions: Sequence[Path] = ()
    adapters: Sequence[str] = ()
    carried: Sequence[str] = ()


class LinkedBridge(Bridge, Protocol):
    """A bridge that says what its links are, so that it can be its own router."""

    def links(self) -> Collection[BridgedLink]:
        """Return the links as they are now; called on any thread."""


class BridgeHost(Protocol):
    """What riot does for the command of a bridge, which knows nothing of Zenoh."""

    def ports(
        self, segments: Mapping[str, str | None], *, system: Path | None = None, cfg: Sequence[str] = ()
    ) -> Mapping[str, AbstractContextManager[Any]]:
        """Return segments in terms of bytes, which connect when they are entered.

        Args:
            segments: Endpoint of each segment by name; None for one of riot.toml, or of a router without one.
            system: riot.toml; None for the one in the working folder, if there is one.
            cfg: `KEY=VALUE`, further Zenoh settings.

        Raises:
            ConfigError: There is no such segment, or a setting is wrong.
        """

    def run(self, bridge: Bridge, *, program: Sequence[str] = (), as_json: bool = False) -> int:
        """Bridge until SIGINT, SIGTERM, a failure, or the end of the program behind the bridge; say what crossed.

        Args:
            bridge: The bridge; it is started and ended here.
            program: Its command and arguments, none if empty; `{WORD}` stands for what `bridge.words()` says.
            as_json: Say it as lines of JSON.

        Returns:
            The program's exit status, 0 if it was still running or there is none; a signal that ended it ends this
            process, too.

        Raises:
            RiotError: It does not start, or has failed.
        """

    def segments(self, asked: OwnRouter) -> Sequence[str]:
        """Return the names of the segments that a router would have.

        Args:
            asked: The router.

        Raises:
            ConfigError: The system file or an option is wrong.
        """

    def run_router(
        self,
        bridge_of: Callable[[Mapping[str, Any]], LinkedBridge],
        asked: OwnRouter,
        *,
        program: Sequence[str] = (),
        as_json: bool = False,
    ) -> int:
        """Route and bridge in one process, until the same events as `run`.

        Args:
            bridge_of: Makes the bridge from open ports of the segments, by name.
            asked: The router.
            program: Command and arguments, as of `run`.
            as_json: Say it as lines of JSON, as of `run`.

        Returns:
            As `run`.

        Raises:
            RiotError: It does not start, has failed, or messages were lost.
        """
