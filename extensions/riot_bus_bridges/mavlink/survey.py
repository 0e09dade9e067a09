"""Survey of MAVLink links: which components send what."""

from __future__ import annotations

import threading
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError
from riot_bus_bridges.links.loop import Loop
from riot_bus_bridges.links.opening import open_link
from riot_bus_bridges.mavlink.routing import addressed
from riot_bus_bridges.mavlink.url import Direction, parse_links

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus_bridges.links.end import End
    from riot_bus_bridges.mavlink.url import LinkSpec
    from riot_bus_mavlink.dialect import Dialect
    from riot_bus_mavlink.frame import Frame

_MOST = 1024  # speakers, and messages of each: ids that senders may make up; pymavlink knows 353 messages


@dataclass(slots=True)
class Speaker:
    """One component of a system.

    Attributes:
        link: Name of the link over which it was heard first.
        kind: Value of `MAV_TYPE` in its heartbeat, None if there was none.
        autopilot: Value of `MAV_AUTOPILOT` there.
        messages: Number of frames by message id.
        targets: Systems that it has sent frames to.
    """

    link: str
    kind: int | None = None
    autopilot: int | None = None
    messages: Counter[int] = field(default_factory=Counter)
    targets: set[int] = field(default_factory=set)


class LinkSurvey:
    """Collects who sends which frames.

    Args:
        targets: Returns the offsets of target system and component of a message type.

    Attributes:
        speakers: Components that were heard, by system and component id.
        skipped: Number of frames that exceed the limits of speakers or kinds.
    """

    def __init__(self, targets: Callable[[int], tuple[int | None, int | None]]) -> None:
        self.speakers: dict[tuple[int, int], Speaker] = {}
        self.skipped = 0
        self._targets = targets

    def see(self, frame: Frame, link: str) -> None:
        """Record a frame that came over a link."""
        source = frame.system, frame.component
        speaker = self.speakers.get(source)
        if speaker is None:
            if len(self.speakers) >= _MOST:
                self.skipped += 1
                return
            speaker = self.speakers[source] = Speaker(link)
        if frame.message_id not in speaker.messages and len(speaker.messages) >= _MOST:
            self.skipped += 1
            return
        speaker.messages[frame.message_id] += 1
        target = addressed(frame, self._targets(frame.message_id))[0]
        if target:
            speaker.targets.add(target)
        if frame.message_id == 0:  # HEARTBEAT
            payload = frame.payload.ljust(9, b"\0")
            speaker.kind, speaker.autopilot = payload[4], payload[5]


def listen(
    links: Sequence[str], dialect: Dialect, *, seconds: float, warn: Callable[[str], None] = lambda line: None
) -> tuple[LinkSurvey, list[LinkSpec]]:
    """Listen to links for a while; nothing is sent.

    Returns:
        What was heard, and the links.

    Raises:
        ConfigError: A link is not usable.
        EnvironmentFaultError: A link cannot be opened.
    """
    specs = parse_links(links, id_of=dialect.id_of)
    for spec in specs:
        if spec.direction is Direction.SENDER:
            raise ConfigError("nothing comes from there", where=spec.text, hint="name a link that frames come over")
    host = _Listener(dialect, warn)
    opened = []
    try:
        opened += [open_link(spec, host) for spec in specs]
        host.loop.start()
        threading.Event().wait(seconds)
    finally:
        host.loop.stop()
        for link in opened:
            link.close()
        host.loop.close()
    return host.survey, specs


class _Listener:
    """A host of links that only listens."""

    def __init__(self, dialect: Dialect, warn: Callable[[str], None]) -> None:
        self.loop = Loop()
        self.crc_extra: Callable[[int], int | None] = dialect.crc_extra
        self.survey = LinkSurvey(dialect.targets)
        self._warn = warn

    def join(self, end: End) -> None:
        pass

    def leave(self, end: End) -> None:
        pass

    def receive(self, end: End, packets: Sequence[bytes]) -> None:
        for data in packets:
            for frame in end.framer.feed(data):
                self.survey.see(frame, end.link)

    def warn(self, spec: LinkSpec, text: str) -> None:
        self._warn(f"warning: {spec.name} ({spec.where}): {text}")
