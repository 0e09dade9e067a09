"""A first draft of the system file from what a network showed; pure. Comments name what it cannot show."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from riot_bus.draft.process_facts import NodeStart
    from riot_bus.graph.survey import Started
    from riot_bus.types.capabilities import Announcement

OUTSIDE, INSIDE = "outside", "inside"
"""Default names of the segments in a draft."""

_PLUMBING = frozenset({"/rosout", "/parameter_events"})
_SETTING = re.compile(r"^[-\s]+(history|depth|reliability|durability):\s*(\w+)\s*$", re.MULTILINE)
_QOS = {
    ("reliability", "2"): "best effort",
    ("reliability", "best_effort"): "best effort",
    ("durability", "1"): "transient local",
    ("durability", "transient_local"): "transient local",
    ("history", "2"): "keep all",
    ("history", "keep_all"): "keep all",
}


@dataclass(frozen=True, slots=True, order=True)
class Used:
    """A topic that a component reads or writes.

    Attributes:
        topic: Name of the topic.
        type_name: Name of its message type.
        qos: Unusual settings of its publisher; empty for reliable and volatile.
    """

    topic: str
    type_name: str = ""
    qos: str = ""


@dataclass(frozen=True, slots=True)
class DraftComponent:
    """A component: what one Zenoh session announces, which is one process, or a node behind `riot bridge ros2`.

    Attributes:
        name: Name in the system file.
        nodes: Its ROS nodes; empty for a bridge.
        zid: Id of its Zenoh session.
        services: Services that it offers and calls, as text.
        actions: Actions that it offers and calls, as text.
        external: Reason why it counts as external; empty if it does not.
        started: Command of its process, if that is known.
        only: Regular expression that selects it among the processes that `started` has started; empty if it is that.
        dds: Whether it is a node of DDS behind a `riot bridge ros2`.
    """

    name: str
    nodes: tuple[str, ...]
    zid: str
    inputs: tuple[Used, ...] = ()
    outputs: tuple[Used, ...] = ()
    services: tuple[str, ...] = ()
    actions: tuple[str, ...] = ()
    external: str = ""
    started: Started | None = None
    only: str = ""
    dds: bool = False


@dataclass(frozen=True, slots=True)
class SystemDraft:
    """A system as far as the network shows it.

    Attributes:
        external: Reason why the outside world is assumed to control a topic, by topic.
        unit: The component under test, if one was chosen.
        bridged: Whether it is behind a DDS bridge, so that keys do not name types.
        unknown: Types without a known definition.
    """

    parts: tuple[DraftComponent, ...]
    external: Mapping[str, str] = field(default_factory=dict)
    unit: str | None = None
    bridged: bool = False
    unknown: tuple[str, ...] = ()


def sketch(
    announcements: Iterable[Announcement],
    *,
    offered: Mapping[str, Mapping[str, str]] | None = None,
    known: Callable[[str], bool] = lambda _: True,
    unit: str | None = None,
    external: Collection[str] = (),
    started: Mapping[str, Started] | None = None,
    behind: Mapping[str, Mapping[str, NodeStart]] | None = None,
    where: str = "",
) -> SystemDraft:
    """Return the system that nodes and bridges announce.

    Components that the user names are external; if the user names none, those that subscribe to nothing. External
    topics are those that an external component publishes for another one, and those without a known publisher. With a
    unit, only topics that reach it count; if no external component reaches it, those that feed it become external.

    Args:
        announcements: Liveliness tokens of nodes and bridges.
        offered: Quality of service by key.
        known: Function that tells whether a type has a definition.
        unit: Node to test: its full name, the last part of that, or the component's name.
        external: Nodes that play the outside world, named in the same way.
        started: Commands of processes, by session id.
        behind: Processes of the ROS domain behind each `riot bridge ros2`, by session id and name, as
            `process_facts.nodes_of_domain` returns them.
        where: Name of the network in errors.

    Raises:
        EnvironmentFaultError: No nodes were seen.
        ConfigError: A node named by the user was not seen.
    """
    seen = [each for each in announcements if each.source != "advanced token" and not _hidden(each.node)]
    parts = _parts(seen, offered or {}, behind or {})
    if not parts:
        raise EnvironmentFaultError(
            "no ROS 2 nodes were seen",
            where=where,
            hint="do they run with RMW_IMPLEMENTATION=rmw_zenoh_cpp (or behind zenoh-bridge-ros2dds) and connect to "
            "this router? Give it more time with --seconds, or name the router's endpoint with -e",
        )
    parts = [each if each.dds else replace(each, started=(started or {}).get(each.zid)) for each in parts]
    types = sorted({used.type_name for part in parts for used in (*part.inputs, *part.outputs)} - {""})
    return replace(
        described(parts, unit=unit, external=external),
        bridged=any(each.source == "bridge token" for each in seen),
        unknown=tuple(name for name in types if not known(name)),
    )


def described(
    parts: Sequence[DraftComponent], *, unit: str | None = None, external: Collection[str] = ()
) -> SystemDraft:
    """Return the system of these components and mark what is external; rules, arguments and errors as in `sketch`."""
    named = {_find(name, parts) for name in external}
    chosen = None if unit is None else _find(unit, parts)
    parts = [replace(each, external="you said so") if each.name in named else each for each in parts]
    if chosen in named:
        (both,) = (each for each in parts if each.name == chosen)
        nodes = f": {', '.join(both.nodes)} are one process, or behind one bridge" if len(both.nodes) > 1 else ""
        raise ConfigError(f"{unit!r} cannot be under test and external{nodes}", where="--external")
    if not named:
        parts = _guess(parts, chosen)
    return SystemDraft(tuple(parts), _external(parts, chosen), chosen)


def _hidden(name: str) -> bool:
    return any(part.startswith("_") for part in name.split("/"))


def _parts(
    seen: Sequence[Announcement],
    offered: Mapping[str, Mapping[str, str]],
    behind: Mapping[str, Mapping[str, NodeStart]],
) -> list[DraftComponent]:
    by_process: defaultdict[tuple[str, str], list[Announcement]] = defaultdict(list)
    for each in seen:
        by_process[each.zid, each.node if each.zid in behind else ""].append(each)
    drafts = []
    for (zid, _), told in by_process.items():
        nodes = tuple(sorted({each.node for each in told} - {""}))
        drafts.append((nodes or (f"/bridge_{zid[:6]}",), nodes, zid, told))
    taken: set[str] = set()
    parts = []
    for names, nodes, zid, told in sorted(drafts, key=lambda each: (each[0], each[2])):
        starts = behind.get(zid, {})
        start = starts.get(names[0]) or starts.get(f"/{names[0].rpartition('/')[2]}")
        data = [each for each in told if not each.action and each.topic not in _PLUMBING and not _hidden(each.topic)]
        parts.append(
            DraftComponent(
                free_name(names[0], taken),
                nodes,
                zid,
                inputs=_used(data, "subscribes", {}),
                outputs=_used(data, "publishes", offered),
                services=tuple(sorted({f"{each.role} {each.topic}" for each in data if _asks(each)})),
                actions=tuple(sorted({each.action for each in told} - {""})),
                started=start.started if start else None,
                only=start.only if start else "",
                dds=zid in behind,
            )
        )
    return parts


def _asks(each: Announcement) -> bool:
    parameters = each.topic.rpartition("/")[2].endswith(("_parameters", "_parameter_types", "get_type_description"))
    return each.role in ("serves", "calls") and not parameters


def _used(told: Sequence[Announcement], role: str, offered: Mapping[str, Mapping[str, str]]) -> tuple[Used, ...]:
    found = {
        each.topic: Used(each.topic, each.type_name, _qos(offered.get(each.key, {})))
        for each in told
        if each.role == role
    }
    return tuple(sorted(found.values()))


def _qos(details: Mapping[str, str]) -> str:
    settings = _SETTING.findall(details.get("offered_qos_profiles", ""))
    words = list(dict.fromkeys(_QOS[each] for each in settings if each in _QOS))
    depths = {value for name, value in settings if name == "depth"}
    if "transient local" in words and len(depths) == 1 and "keep all" not in words:
        words.append(f"depth {depths.pop()}")
    return ", ".join(words)


def free_name(node: str, taken: set[str]) -> str:
    """Return an unused name for a component in the system file, and add it to `taken`.

    Args:
        node: Name of the node.
        taken: Names already in use.
    """
    base = re.sub(r"[^A-Za-z0-9_-]+", "_", node.strip("/")) or "node"
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


def _external(parts: Sequence[DraftComponent], unit: str | None) -> dict[str, str]:
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
