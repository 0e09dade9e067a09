"""A draft of a system, whatever it was seen by: components, commands, topics, and what is external; pure."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from riot_bus.vocabulary.errors import ConfigError, did_you_mean

OUTSIDE, INSIDE = "outside", "inside"
"""Default names of the segments in a draft."""
MISSING = "FILL_IN"
"""First word of an incomplete command. No program has this name, so nothing starts that would connect elsewhere."""


@dataclass(frozen=True, slots=True)
class TopicDraft:
    """Known facts about a topic that had messages.

    Attributes:
        declare: Whether riot.toml has to declare the type, since keys, encodings and payloads do not identify it.
        fits: Codecs that read all payloads, if it is not clear which of them is right.
        encodings: Encodings of its messages, the most frequent first.
        rate: Messages per second.
        sizes: Sizes of the smallest and the largest payload, in bytes.
        read: Number of payloads that were read.
    """

    topic: str
    key: str
    type_name: str = ""
    declare: bool = False
    fits: tuple[str, ...] = ()
    encodings: tuple[str, ...] = ()
    count: int = 0
    rate: float = 0.0
    sizes: tuple[int, int] = (0, 0)
    read: int = 0


@dataclass(frozen=True, slots=True)
class CommandDraft:
    """SystemDraft of how a component is started, as for riot.toml.

    Attributes:
        missing: Lines that say what the user has to fill in.
        pid: Id of the process that the draft is taken from; 0 if there is none.
        files: Texts of the files that the draft names by `{file:NAME}`, by name.
        only: Regular expression that selects the component among the processes of the command; empty for its own one.
    """

    command: tuple[str, ...]
    cwd: str = "."
    env: Mapping[str, str] = field(default_factory=dict)
    missing: tuple[str, ...] = ()
    pid: int = 0
    files: Mapping[str, str] = field(default_factory=dict)
    only: str = ""

    @property
    def can_start(self) -> bool:
        """Whether nothing is missing that the component needs to start and to connect to riot."""
        return not any(MISSING in word for word in (*self.command, *self.env.values()))


@dataclass(frozen=True, slots=True, order=True)
class Used:
    """A topic that a component reads or writes.

    Attributes:
        qos: Unusual settings of its publisher; empty for reliable and volatile.
    """

    topic: str
    type_name: str = ""
    qos: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class DraftComponent:
    """A component: one process, or a ROS node behind `riot bridge ros2`.

    Attributes:
        zids: Ids of its Zenoh sessions.
        services: Services that it offers and calls, as text.
        actions: Actions that it offers and calls, as text.
        external: Reason why it counts as external; empty if it does not.
        segment: Segment of the router that it was seen on; in a finished draft, its segment in riot.toml.
        peer: Whether it is a Zenoh peer, which may find others without a router.
        dds: Whether it is a node of DDS behind a `riot bridge ros2`.
    """

    name: str
    command: CommandDraft
    zids: tuple[str, ...] = ()
    nodes: tuple[str, ...] = ()
    inputs: tuple[Used, ...] = ()
    outputs: tuple[Used, ...] = ()
    services: tuple[str, ...] = ()
    actions: tuple[str, ...] = ()
    external: str = ""
    segment: str = ""
    notes: tuple[str, ...] = ()
    peer: bool = False
    dds: bool = False

    @property
    def silent(self) -> bool:
        """Whether it is not known to read, write or offer anything."""
        return not (self.inputs or self.outputs or self.services)


@dataclass(frozen=True, slots=True, kw_only=True)
class SystemDraft:
    """A draft of a system, as far as it was seen.

    Attributes:
        external: Reason why the outside world is assumed to control a topic, by topic.
        unit: The component under test, if one was chosen.
        adapter: Adapter whose announcements it is made of; empty if it is made of a graph and messages.
        unknown_types: Types without a known definition.
        groups: Keys by the name of their topic in inputs and outputs: the key itself, or a key expression for several.
        topics: Known facts about each topic that had messages, by its name in `groups`.
        unwritten: Topics that had messages from an unknown publisher.
        unread: Topics that an unknown subscriber reads.
        skipped: Number of keys that were not examined because there were too many.
        listener: Whether a component reads everything, which hides who else reads what.
    """

    parts: tuple[DraftComponent, ...]
    external: Mapping[str, str] = field(default_factory=dict)
    unit: str | None = None
    adapter: str = ""
    unknown_types: tuple[str, ...] = ()
    groups: Mapping[str, list[str]] = field(default_factory=dict)
    topics: Mapping[str, TopicDraft] = field(default_factory=dict)
    unwritten: tuple[str, ...] = ()
    unread: tuple[str, ...] = ()
    skipped: int = 0
    listener: bool = False

    @property
    def names(self) -> dict[str, str]:
        """The name of the component of each session, by the session's id."""
        return {zid: part.name for part in self.parts for zid in part.zids}


def draft_of(
    parts: Sequence[DraftComponent], *, unit: str | None = None, external: Collection[str] = ()
) -> SystemDraft:
    """Return the system of these components, with what is external and their segments.

    Components that the user names are external; if the user names none, those that subscribe to nothing. External
    topics are those that an external component publishes for another one, and those without a known publisher. With a
    unit, only topics that reach it count; if no external component reaches it, those that feed it become external.

    Args:
        parts: Components that were seen.
        unit: Component to test: its name, the full name of a node of it, or the last part of that.
        external: Components that play the outside world, named in the same way.

    Raises:
        ConfigError: A component that was named was not seen, or is both under test and external.
    """
    named = {_find(name, parts) for name in external}
    chosen = None if unit is None else _find(unit, parts)
    if chosen in named:
        (both,) = (each for each in parts if each.name == chosen)
        nodes = f": {', '.join(both.nodes)} are one process, or behind one bridge" if len(both.nodes) > 1 else ""
        raise ConfigError(f"{unit!r} cannot be under test and external{nodes}", where="--external")
    if named:
        parts = [replace(each, external="you said so") if each.name in named else each for each in parts]
    else:
        parts = _guess(parts, chosen)
    return SystemDraft(parts=tuple(_with_segments(parts)), external=_external(parts, chosen), unit=chosen)


def free_name(text: str, taken: set[str]) -> str:
    """Return an unused name for a component in the system file, and add it to `taken`."""
    base = re.sub(r"[^A-Za-z0-9_-]+", "_", text.strip("/")) or "node"
    name, number = base, 1
    while name in taken:
        number += 1
        name = f"{base}_{number}"
    taken.add(name)
    return name


def _find(name: str, parts: Sequence[DraftComponent]) -> str:
    spellings = (
        {part.name: (part.name,) for part in parts},
        {part.name: part.nodes for part in parts},
        {part.name: tuple(node.rpartition("/")[2] for node in part.nodes) for part in parts},
    )
    for spelled in spellings:
        found = [part for part, words in spelled.items() if name in words]
        if len(found) == 1:
            return found[0]
        if found:
            raise ConfigError(f"several nodes are called {name!r}", hint=f"name one of: {', '.join(found)}")
    known = [node for part in parts for node in (*part.nodes, part.name)]
    raise ConfigError(f"no node {name!r} was seen", hint=did_you_mean(name, known))


def _guess(parts: Sequence[DraftComponent], unit: str | None) -> list[DraftComponent]:
    """Mark components that only publish as external; if none of them reaches the unit, also those that feed it."""
    reaching = _upstream(parts, unit)
    found = [
        replace(each, external="it subscribes to nothing")
        if each.outputs and not each.inputs and each.name != unit
        else each
        for each in parts
    ]
    if unit is None or any(each.external and each.name in reaching for each in found):
        return found
    inputs = {used.topic for part in parts if part.name == unit for used in part.inputs}
    feeding = {part.name for part in parts if any(used.topic in inputs for used in part.outputs)} - {unit}
    why = f"it feeds {unit}, and nothing else of what reaches that comes from outside"
    return [replace(each, external=why) if each.name in feeding else each for each in found]


def _upstream(parts: Sequence[DraftComponent], unit: str | None) -> set[str]:
    """Return the components that reach the unit over topics, the unit included; all components if unit is None."""
    if unit is None:
        return {part.name for part in parts}
    reached = {unit}
    while True:
        wanted = {used.topic for part in parts if part.name in reached for used in part.inputs}
        more = {part.name for part in parts if any(used.topic in wanted for used in part.outputs)} - reached
        if not more:
            return reached
        reached |= more


def _with_segments(parts: Sequence[DraftComponent]) -> Sequence[DraftComponent]:
    """Return components with their segments: the router's, if these separate the outside, else two new ones."""
    outside, inside = ({each.segment for each in parts if bool(each.external) is way} for way in (True, False))
    if outside and inside and not outside & inside and "" not in outside | inside:
        return parts
    return [replace(each, segment=OUTSIDE if each.external else INSIDE) for each in parts]


def _external(parts: Sequence[DraftComponent], unit: str | None) -> dict[str, str]:
    """Return the reason why a topic is external, for each that is."""
    reaching = _upstream(parts, unit)
    published: defaultdict[str, list[DraftComponent]] = defaultdict(list)
    for part in parts:
        for used in part.outputs:
            published[used.topic].append(part)
    read = {used.topic for part in parts if part.name in reaching and not part.external for used in part.inputs}
    found = {}
    for topic in sorted(read):
        outside = [part.name for part in published[topic] if part.external]
        if outside:
            found[topic] = f"from {', '.join(outside)}"
        elif not published[topic]:
            found[topic] = "no publisher was seen"
    return found
