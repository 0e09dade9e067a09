"""A bridge between links of MAVLink and segments."""

from __future__ import annotations

import logging
import time
from collections import Counter
from functools import partial
from typing import TYPE_CHECKING, Any

from riot_bus.types.port import BridgedLink
from riot_bus_bridges.bridging import LinkedBridge
from riot_bus_bridges.links.loop import Loop
from riot_bus_bridges.links.opening import open_link
from riot_bus_bridges.mavlink.mirror import Mirror
from riot_bus_bridges.mavlink.routing import Duplicates, Routes
from riot_bus_bridges.mavlink.sequences import OwnStreams
from riot_bus_bridges.mavlink.side import Side, new_mark
from riot_bus_bridges.mavlink.tally import LinkTally, ready_line, summary_lines
from riot_bus_bridges.mavlink.url import FILES, LISTENS, Direction

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence
    from contextlib import ExitStack

    from riot_bus_bridges.host.inner import BridgePort
    from riot_bus_bridges.links.end import End
    from riot_bus_bridges.links.link import Link
    from riot_bus_bridges.mavlink.options import MavlinkBridgeOptions
    from riot_bus_bridges.mavlink.url import LinkSpec

JSON_LINK = "json"
"""Name that replaces the link in the keys of frames received as JSON."""

_LOG = logging.getLogger(__name__)


class MavlinkBridge(LinkedBridge):
    """Context manager that carries frames between links and segments while it is open."""

    def __init__(
        self,
        ports: Mapping[str, BridgePort],
        options: MavlinkBridgeOptions,
        *,
        warn: Callable[[str], None] = _LOG.warning,
    ) -> None:
        super().__init__(warn=warn)
        self._patient = options.patient
        self._plan = options.plan(list(ports))
        dialect, signer, mark = self._plan.dialect, self._plan.signer, new_mark()
        self._sides = {
            name: Side(
                port,
                Routes(
                    dialect.targets,
                    duplicates=Duplicates(options.duplicates) if options.duplicates else None,
                    sniffer=options.sniffer or -1,
                ),
                keys=self._plan.keys,
                name_of=dialect.name_of,
                mark=mark,
                streams=OwnStreams(dialect.crc_extra, signer),
                linked=self._is_linked,
                signer=signer,
            )
            for name, port in ports.items()
        }
        if options.mirror is not None:
            from riot_bus_bridges.mavlink.mirror import JsonForm

            form = JsonForm(dialect)
            for number, side in enumerate(self._sides.values()):
                insert = None if number else partial(side.insert, link=JSON_LINK)  # JSON reaches all segments
                fields = options.mirror == "fields"
                side.mirror = Mirror(side.port, form, fields=fields, streams=side.streams, insert=insert)
        listening = (spec for spec in self._plan.links if spec.kind in LISTENS)
        self.listens = [f"{spec.kind.partition(' ')[0]}/{spec.where}" for spec in listening]
        self._tallies = {spec.name: LinkTally(spec) for spec in self._plan.links}
        self._links: list[Link] = []
        self.loop = Loop()
        self.crc_extra: Callable[[int], int | None] = dialect.crc_extra

    def open(self, stack: ExitStack) -> None:
        """Open the links, join the segments, and start to carry frames."""
        stack.callback(self.loop.close)
        sides = list(self._sides.values())
        mirrors = [side.mirror for side in sides if side.mirror is not None]
        parts: list[Side | Mirror] = [*sides, *mirrors]
        for part in parts:
            stack.callback(part.close)
        stack.callback(self._close_links)
        for side in sides:
            stack.callback(side.stop_listening)
        for spec in self._plan.links:
            self._links.append(open_link(spec, self))
        for part in mirrors if self._patient else parts:
            part.open()
        if not self._patient:
            self._await_each_other()
        stack.callback(self.loop.stop)
        self.loop.start()

    def _await_each_other(self) -> None:
        """Wait until frames can reach the other segments, before any are taken from links."""
        deadline = time.monotonic() + 5.0
        for name, side in self._sides.items() if len(self._sides) > 1 else ():
            if not side.await_subscriber(deadline - time.monotonic()):
                self.report_problem(f"frames of segment {name!r} get to no other segment: does a router join them?")

    def _close_links(self) -> None:
        for link in self._links:
            self._tallies[link.spec.name].end(link)
            link.close()

    def status(self) -> dict[str, Any]:
        """Return the state of the bridge as JSON values."""
        return {
            "dialect": self._plan.dialect.name,
            "keys": self._plan.keys.text,
            "segments": {
                name: {"endpoint": side.port.endpoint, **dict(sorted(self._counts(name).items()))}
                for name, side in self._sides.items()
            },
            "links": {link.spec.name: self._tallies[link.spec.name].status(link) for link in self._links},
            "problems": list(self.problems),
        }

    def links(self) -> Collection[BridgedLink]:
        """Return the links, as graphs show them."""
        speakers: dict[str, dict[str, str]] = {name: {} for name in self._tallies}
        for side in self._sides.values():
            for link, system, component, key in side.published():
                speakers.get(link, {})[key] = f"{system}/{component}"
        return [
            BridgedLink(
                spec.segment,
                spec.name,
                self._tallies[spec.name].addresses(),
                speakers[spec.name],
                "" if spec.direction is Direction.RECEIVER else self._plan.keys.expression(),
            )
            for spec in self._plan.links
        ]

    def ready(self) -> str:
        """Return a line that says what is bridged."""
        return ready_line(self.status())

    def words(self) -> dict[str, str]:
        """Return the value of `{port}` in the command of a program behind the bridge: the first listening port."""
        first = next((link for link in self._links if link.spec.kind in LISTENS), None)
        return {} if first is None else {"port": first.where.rpartition(":")[2]}

    def summary(self) -> Sequence[str]:
        """Return lines that say what crossed."""
        return summary_lines(self.status())

    def join(self, end: End) -> None:
        """Take a new end of a link, which gets frames from now on."""
        tally, side = self._tallies[end.link], self._sides[end.segment]
        tally.join(end)
        side.routes.add(end)
        if self._patient and not side.is_open and (tally.spec.kind not in FILES or self._all_files(end.segment)):
            side.open()

    def leave(self, end: End) -> None:
        """Forget an end that is gone."""
        end.flush()
        self._sides[end.segment].routes.remove(end)
        self._tallies[end.link].leave(end)

    def receive(self, end: End, packets: Sequence[bytes]) -> None:
        """Take packets, or pieces of a stream, in the order in which they came."""
        self._sides[end.segment].receive(end, packets)

    def warn(self, spec: LinkSpec, text: str) -> None:
        """Report a problem once."""
        self.report_problem(f"{spec.name} ({spec.where}): {text}")

    def _counts(self, segment: str) -> Counter[str]:
        side = self._sides[segment]
        return side.counts + (Counter() if side.mirror is None else side.mirror.counts)

    def _all_files(self, segment: str) -> bool:
        """Return whether all links of a segment are logs."""
        return all(spec.kind in FILES for spec in self._plan.links if spec.segment == segment)

    def _is_linked(self, system: int, component: int) -> bool:
        return any(side.routes.knows(system, component) for side in self._sides.values())
