"""Network between two ends: one plain router, a bus, or a router that is already running."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, Self

from riot_bus.router.bus import Bus
from riot_bus.zenoh.segments import Segment
from riot_bus.zenoh.session import prepare_runtime

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus_conformance.end import EndName
    from riot_bus_conformance.security import Settings

_UNUSED = "riot/unused"
_ENDS: tuple[EndName, EndName] = ("left", "right")


class ScenarioNetwork(Protocol):
    """A network to which two ends connect; a context manager."""

    def endpoint(self, end: EndName) -> str:
        """Return the endpoint that an end connects to."""

    def restart(self) -> None:
        """Close the network, and open it again at the same endpoints."""

    def report(self) -> list[str]:
        """Return the losses that the network reports, a text each."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *error: object) -> None: ...


class _OwnNetwork:
    """A network that is opened here."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._listen: dict[str, Sequence[str]] = dict.fromkeys(_ENDS, (settings.listen,))
        self._opened: Segment | Bus | None = None

    def endpoint(self, end: EndName) -> str:
        return self._listen[end][0]

    def restart(self) -> None:
        self.__exit__()
        self.__enter__()

    def __enter__(self) -> Self:
        raise NotImplementedError

    def __exit__(self, *error: object) -> None:
        if self._opened is not None:
            self._opened.close()


class PlainNetwork(_OwnNetwork):
    """One plain Zenoh router."""

    def report(self) -> list[str]:  # noqa: D102
        return []

    def __enter__(self) -> Self:
        prepare_runtime()
        self._opened = Segment("plain", self._listen["left"], config=self._settings.router)
        self._listen = dict.fromkeys(_ENDS, self._opened.endpoints)
        return self


class BusNetwork(_OwnNetwork):
    """A riot bus, one segment for each end.

    Args:
        intercept: Keys that go through a pipeline without interceptors.
        changed: Whether something else was intercepted before: then the segments are no longer linked directly.
    """

    def __init__(self, settings: Settings, intercept: Sequence[str] = (), *, changed: bool = False) -> None:
        super().__init__(settings)
        self._intercept, self._changed = intercept, changed

    def report(self) -> list[str]:  # noqa: D102
        losses = self._opened.losses if isinstance(self._opened, Bus) else None
        if not losses:
            return []
        lost = [f"{count} messages of {key} were lost" for key, count in losses.messages.items()]
        return lost + [str(link) for link in losses.links]

    def __enter__(self) -> Self:
        first = [_UNUSED] if self._changed else self._intercept
        self._opened = bus = Bus(self._listen, intercept=first, config=self._settings.router)
        bus.open()
        if self._changed:
            bus.set_intercept(self._intercept)
        self._listen = {name: bus.segment(name).endpoints for name in _ENDS}
        return self


class RunningNetwork:
    """A router that is already running, of riot or not."""

    def __init__(self, left: str, right: str) -> None:
        self._endpoints = {"left": left, "right": right}

    def endpoint(self, end: EndName) -> str:  # noqa: D102 - see Network
        return self._endpoints[end]

    def restart(self) -> None:  # noqa: D102
        raise NotImplementedError("a running router is left alone: do not run scenarios that need to restart it")

    def report(self) -> list[str]:  # noqa: D102
        return []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        return
