"""First draft of a system file from what was heard on links; gaps are marked with FILL IN."""

from __future__ import annotations

import threading
from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from riot_bus.types.capabilities import HeardSystem
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.redaction import escape_control_chars as _comment
from riot_bus.vocabulary.toml_text import toml_string
from riot_bus_bridges.links.loop import Loop
from riot_bus_bridges.links.opening import open_link
from riot_bus_bridges.mavlink.routing import addressed
from riot_bus_bridges.mavlink.url import Direction, free_name, parse_links
from riot_bus_mavlink.keys import KeyTemplate

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Sequence

    from riot_bus_bridges.links.end import End
    from riot_bus_bridges.mavlink.url import LinkSpec
    from riot_bus_mavlink.adapter import MavlinkAdapter
    from riot_bus_mavlink.dialect import Dialect
    from riot_bus_mavlink.frame import Frame

_MOST = 1024  # speakers, and messages of each: ids that senders may make up; pymavlink knows 353 messages


@dataclass(slots=True)
class Speaker:
    """One component of a system."""

    link: str
    kind: int | None = None
    autopilot: int | None = None
    messages: Counter[int] = field(default_factory=Counter)
    targets: set[int] = field(default_factory=set)


class LinkSurvey:
    """Collects who sends which frames."""

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
    """Listen to links for a while, sending nothing; raises ConfigError or EnvironmentFaultError for a useless link."""
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


OUTSIDE, INSIDE = "outside", "inside"
UNIT = "unit"
"""Name of the unit and of its link."""
_NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID


@dataclass(frozen=True, slots=True)
class LinkComponent:
    """Component of the system file: all senders behind a link, or the unit.

    Attributes:
        topics: Keys of their messages, each with the number of frames per second.
    """

    name: str
    who: Sequence[str]
    url: str
    topics: dict[str, float]
    link: str = ""


@dataclass(frozen=True, slots=True)
class Sketch:
    """What was heard on the links, as the parts of a system."""

    outside: Sequence[LinkComponent]
    unit: LinkComponent
    skipped: int


def sketch(
    survey: LinkSurvey, specs: Sequence[LinkSpec], dialect: Dialect, *, seconds: float, unit: int | None = None
) -> Sketch:
    """Return what was heard as parts of a system.

    The unit under test is the system that the user names; otherwise one without an autopilot, such as a ground station,
    if others were heard, too; otherwise one that was not heard. All others are the outside world.

    Raises:
        EnvironmentFaultError: Nothing was heard.
        ConfigError: The unit was not heard.
    """
    systems = sorted({system for system, _ in survey.speakers})
    if not systems:
        hint = "check that something sends there, listen longer with --seconds, or name another link"
        raise EnvironmentFaultError("nothing was heard", where=", ".join(spec.text for spec in specs), hint=hint)
    if unit is not None and unit not in systems:
        heard = f"heard: {', '.join(map(str, systems))}"
        raise ConfigError(f"system {unit} was not heard", where="--unit", hint=heard)
    if unit is None and len(systems) > 1:
        unit = next((system for system in systems if _has_no_autopilot(system, survey)), None)
    keys = KeyTemplate()

    def part(name: str, link: str, url: str, sources: Iterable[tuple[int, int]]) -> LinkComponent:
        who, topics = [], {}
        for source in sorted(sources):
            speaker = survey.speakers[source]
            who.append(_who(source, speaker, dialect))
            for number, count in speaker.messages.items():
                topics[keys.key(link, *source, dialect.name_of(number))] = count / seconds
        return LinkComponent(name, who, url, dict(sorted(topics.items())), link)

    own = [source for source in survey.speakers if source[0] == unit]
    taken = {UNIT}
    outside = []
    for spec in specs:
        sources = [each for each, speaker in survey.speakers.items() if speaker.link == spec.name and each[0] != unit]
        if sources:
            outside.append(part(free_name(spec.name.replace(".", "_"), taken), spec.name, spec.url, sources))
    return Sketch(outside, part(UNIT, UNIT, "", own), survey.skipped)


def _has_no_autopilot(system: int, survey: LinkSurvey) -> bool:
    kinds = [each for (one, _), each in survey.speakers.items() if one == system and each.kind is not None]
    return bool(kinds) and all(each.autopilot == _NO_AUTOPILOT for each in kinds)


def _who(source: tuple[int, int], speaker: Speaker, dialect: Dialect) -> str:
    text = f"{source[0]}/{source[1]}"
    if speaker.kind is None or speaker.autopilot is None:
        return text
    words = [_entry(dialect, "MAV_TYPE", speaker.kind)]
    if speaker.autopilot != _NO_AUTOPILOT:
        words.append(_entry(dialect, "MAV_AUTOPILOT", speaker.autopilot))
    return f"{text} ({', '.join(words)})"


def _entry(dialect: Dialect, enum: str, value: int) -> str:
    table = dialect.enums.get(enum)
    entry = table.entries.get(value) if table is not None else None
    return str(value) if entry is None else entry.name.removeprefix(f"{enum}_")


def sketch_json(found: Sketch) -> dict[str, Any]:
    """Return the sketch as JSON values."""
    return {"outside": [asdict(part) for part in found.outside], "unit": asdict(found.unit), "skipped": found.skipped}


def sketch_lines(found: Sketch) -> list[str]:
    """Return a human-readable line for each part."""
    return [
        f"{part.name}  {'inside' if part is found.unit else 'outside'}  {len(part.topics)} topics  "
        f"{', '.join(part.who) or 'not heard'}"
        for part in (*found.outside, found.unit)
    ]


def sketch_toml(found: Sketch, *, origin: str) -> str:
    """Return the text of a system file."""
    topics = {key: rate for part in found.outside for key, rate in part.topics.items()}
    head = [
        f"# Written by `riot init`: {_comment(origin)}.",
        "# What links cannot tell is marked with FILL IN. All keys: docs/riot-toml.md; links: docs/mavlink-bridge.md.",
        "",
        "[system]",
        'name = "mavlink"',
        f'segments = ["{OUTSIDE}", "{INSIDE}"]',
        'adapters = ["mavlink"]',
        '# sources = ["src/**/*.py"]   # FILL IN: the code under test; without it, stored trials outlive its changes',
    ]
    external = [
        "[external]",
        "# What the outside world controls. FILL IN: take out what it does not.",
        *_topics("topics", topics),
    ]
    unit = [
        f"[unit.{found.unit.name}]",
        '# log = "nominal.mcap"   # a recording of its inputs; without it, the system is run to make one',
    ]
    blocks = [head, *(_outside(part) for part in found.outside), _inside(found.unit, topics), external, unit]
    return "\n\n".join("\n".join(lines) for lines in blocks) + "\n"


def _outside(part: LinkComponent) -> list[str]:
    return [
        f"[components.{part.name}]",
        f"# Heard there: {_comment(', '.join(part.who))}.",
        "# FILL IN: a real vehicle does not begin anew for each run; a simulator can be started behind `--`.",
        *_command("--link", f"/{part.link}={part.url}"),
        f'segment = "{OUTSIDE}"',
        "external = true",
        *_topics("outputs", part.topics),
    ]


def _inside(unit: LinkComponent, inputs: Collection[str]) -> list[str]:
    who = _comment(", ".join(unit.who)) or "it was not heard"
    return [
        f"[components.{unit.name}]",
        f"# What is tested: {who}. FILL IN: the program, which has a bridge of its own.",
        *_command("--link", f"/{UNIT}=udpin:127.0.0.1:0", "--", "PROGRAM", "udpout:127.0.0.1:{port}"),
        f'segment = "{INSIDE}"',
        *_topics("inputs", dict.fromkeys(inputs)),
        *_topics("outputs", unit.topics),
    ]


def _command(*words: str) -> list[str]:
    start = ("{python}", "-m", "riot_bus", "bridge", "mavlink", "--endpoint", "{endpoint}")
    lines = [", ".join(map(toml_string, each)) for each in (start, words)]
    return ["command = [", *(f"    {line}," for line in lines), "]"]


def _topics(name: str, topics: dict[str, Any]) -> list[str]:
    if not topics:
        return [f"{name} = []"]
    width = max(len(toml_string(key)) for key in topics) + 1
    rows = [
        f"    {toml_string(key) + ',':{width}}" + ("" if rate is None else f"   # {rate:.3g}/s")
        for key, rate in topics.items()
    ]
    return [f"{name} = [", *(row.rstrip() for row in rows), "]"]


class MavlinkListener:
    """Listens to MAVLink links; see `riot_bus.types.capabilities.ListensToLinks`."""

    def __init__(self, adapter: MavlinkAdapter) -> None:
        self._adapter = adapter

    def listen(
        self, links: Sequence[str], *, seconds: float, unit: str | None, warn: Callable[[str], None]
    ) -> HeardSystem:
        """Listen to MAVLink links for some seconds; `unit` is the id of a system."""
        if unit is not None and not (unit.isascii() and unit.isdigit()):
            raise ConfigError(f"{unit!r} is not the id of a system", where="--unit", hint="a number from 1 to 255")
        survey, specs = listen(links, self._adapter.dialect, seconds=seconds, warn=warn)
        found = sketch(survey, specs, self._adapter.dialect, seconds=seconds, unit=None if unit is None else int(unit))
        origin = f"what came over {', '.join(links)} within {seconds:g} s"
        return HeardSystem(sketch_toml(found, origin=origin), sketch_json(found), sketch_lines(found))
