"""The segments of a bus and the junction between them, which may be opened before the rest of the bus."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from riot_bus.config.router_settings import SegmentSettings
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.direct_links import DirectLinks, are_possible
from riot_bus.zenoh.junction import Junction
from riot_bus.zenoh.segments import Segment, is_open_to_all
from riot_bus.zenoh.session import prepare_runtime
from riot_bus.zenoh.session_config import WAIT_BEFORE_CLOSE_S
from riot_bus.zenoh.socket_folder import socket_folder

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import zenoh

_SHARED_MEMORY = "transport/shared_memory/enabled"
_PROTOCOLS = "transport/link/protocols"
_OWN_PROTOCOL = "unixsock-stream"
_PLACES = 3  # for the junction in use, for the next one, and for another try if that one fails


class Network:
    """Segments that are isolated until a junction joins them; a context manager.

    Args:
        segments: Settings of each segment by name, or just its endpoints to listen on; empty for a free port of this
            machine.
        wait_before_close_s: Longest wait of a BLOCK publication for a slow receiver before its link is closed.
        timeout: Seconds within which segments must be joined.

    Attributes:
        junction: The junction; None if there is only one segment, and before it is open.
        direct: Direct links; None with one segment, if the user's configuration prevents them, and before they open.
    """

    def __init__(
        self,
        segments: Mapping[str, SegmentSettings | Sequence[str]],
        *,
        config: Mapping[str, Any] | None = None,
        wait_before_close_s: float = WAIT_BEFORE_CLOSE_S,
        timeout: float = 10.0,
    ) -> None:
        if not segments:
            raise ConfigError("a bus needs at least one segment", hint="such as unit=tcp/127.0.0.1:7447")
        self.settings = {
            name: each if isinstance(each, SegmentSettings) else SegmentSettings(listen=tuple(each))
            for name, each in segments.items()
        }
        self.segments: dict[str, Segment] = {}
        self.junction: Junction | None = None
        self.direct: DirectLinks | None = None
        self.wait_before_close_s = wait_before_close_s
        self._config = dict(config or {})
        self._timeout = timeout
        self._open = False
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(self, *error: object) -> None:
        self.close()

    def open(self, cut: Sequence[str] = (), services: Sequence[str] = ()) -> Self:
        """Open the segments, unless they are open.

        Raises:
            ConfigError: Zenoh rejects a configuration.
            EnvironmentFaultError: An endpoint is in use.
        """
        if self._open:
            return self
        prepare_runtime()
        with ExitStack() as stack:
            configs = {name: _admitting_own({**self._config, **each.config}) for name, each in self.settings.items()}
            closed = [name for name, each in self.settings.items() if not is_open_to_all(each.listen, configs[name])]
            several = len(self.settings) > 1
            folder = stack.enter_context(socket_folder()) if several else Path()
            inner = [f"{_OWN_PROTOCOL}/{folder}/{number}" for number in range(_PLACES)] if several and closed else []
            if several and are_possible(configs):
                self.direct = DirectLinks(list(self.settings), folder, cut=cut, services=services)
            for name, each in self.settings.items():
                direct = self.direct
                places = range(_PLACES if several and name not in closed else 0)
                segment = Segment(
                    name,
                    each.listen,
                    connect=[*each.connect, *(direct.connect(name) if direct is not None else ())],
                    doors=[f"{_OWN_PROTOCOL}/{folder}/door-{len(self.segments)}-{place}" for place in places],
                    inner=inner if name in closed else (),
                    hidden=direct.listen(name) if direct is not None else (),
                    config=configs[name] | (direct.config(name) if direct is not None else {}),
                    wait_before_close_s=self.wait_before_close_s,
                )
                stack.callback(segment.close)
                self.segments[name] = segment
                if direct is not None:
                    # Zenoh 1.10.2 panics in a router that is closed while it processes that another one has left.
                    stack.callback(direct.sever, list(self.segments.values()))
            if self.direct is not None:
                self.direct.complete(list(self.segments.values()))
            if several:
                # Without it in the junction's configuration, too, shared memory would end there.
                shared = any(config.get(_SHARED_MEMORY) for config in configs.values())
                self.junction = Junction(
                    list(self.segments.values()),
                    direct=self.direct,
                    inner=inner,
                    config={_SHARED_MEMORY: True} if shared else {},
                    wait_before_close_s=self.wait_before_close_s,
                    timeout=self._timeout,
                )
                stack.callback(self.junction.close)
            self._stack, self._open = stack.pop_all(), True
        return self

    def begin(self, cut: Sequence[str] = (), services: Sequence[str] = ()) -> None:
        """Open the segments and begin to join them; opening the bus waits for the rest.

        Raises:
            ConfigError: Zenoh rejects a configuration.
            EnvironmentFaultError: An endpoint is in use.
        """
        self.open(cut, services)
        if self.junction is not None:
            self.junction.begin(cut, services)

    def close(self) -> None:
        """Separate the segments and disconnect all components; safe to call twice."""
        self._open = False
        self._stack.close()

    def linked(self) -> set[str]:
        """Return the ids of the routers whose links join the segments at present: the junction and linked segments."""
        junction = {self.junction.zid} - {""} if self.junction is not None else set()
        return junction | (self.direct.ids if self.direct is not None else set())

    @property
    def sessions(self) -> dict[str, zenoh.Session]:
        """The segments' own sessions."""
        return {name: segment.session for name, segment in self.segments.items()}


def _admitting_own(config: dict[str, Any]) -> dict[str, Any]:
    """Add riot's own protocol to a segment with restricted protocols, so that it can be linked to the others."""
    protocols = config.get(_PROTOCOLS)
    if not isinstance(protocols, list) or not protocols or _OWN_PROTOCOL in protocols:
        return config
    return {**config, _PROTOCOLS: [*protocols, _OWN_PROTOCOL]}
