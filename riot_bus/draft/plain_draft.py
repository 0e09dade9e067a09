"""The draft of a plain Zenoh system, from its graph and a short recording: components, their names and topics; pure."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from riot_bus.draft.command_draft import unknown_command
from riot_bus.draft.plain_topics import remark, topic_groups, topics_by_name, uses_of
from riot_bus.draft.system_draft import INSIDE, OUTSIDE, DraftComponent, SystemDraft, Used, described, free_name
from riot_bus.vocabulary.errors import EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Collection, Hashable, Mapping, Sequence

    from riot_bus.draft.command_draft import CommandDraft
    from riot_bus.draft.plain_topics import Uses
    from riot_bus.draft.topic_look import TopicDraft
    from riot_bus.graph.model import ConnectedComponent, Graph

_NAMELESS, _NOTHING = "component", "nothing tells what components there are"
_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
_MODULE = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+")
Process = tuple["ConnectedComponent", ...]


@dataclass(frozen=True, slots=True)
class PlainFacts:
    """Observed facts about a system.

    Attributes:
        graph: Connected components, and what they publish and read, as far as that is known.
        topics: By key, what the messages reveal about the topic.
        commands: Drafts of the components' commands, by the id of their session.
        skipped: Number of keys that were not examined because there were too many.
        where: Name of the network or the log in errors.
        no_command: Reason why a component has no command here.
        listener: Whether a component reads everything, which hides who else reads what.
    """

    graph: Graph
    topics: Mapping[str, TopicDraft]
    commands: Mapping[str, CommandDraft] = field(default_factory=dict)
    skipped: int = 0
    where: str = ""
    no_command: str = "no process of this machine and user has its connection"
    listener: bool = False


@dataclass(frozen=True, slots=True)
class PlainDraft:
    """A draft of a system, as far as it was observed.

    Attributes:
        system: Components, with what they read and write, and what is external.
        commands: Draft of each component's command, by its name.
        segments: Segment of each component, by its name.
        sessions: Name of the component of each session, by the session's id.
        groups: Keys by the name of their topic in inputs and outputs: the key itself, or a key expression for several.
        topics: Known facts about each topic that had messages, by its name in `groups`.
        unwritten: Topics that had messages from an unknown publisher.
        unread: Topics that an unknown subscriber reads.
        silent: Components that are not known to read or write anything.
        peers: Components that are Zenoh peers, and may find others without a router.
        skipped, listener: The same as in `PlainFacts`.
    """

    system: SystemDraft
    commands: Mapping[str, CommandDraft]
    segments: Mapping[str, str]
    sessions: Mapping[str, str]
    groups: Mapping[str, list[str]]
    topics: Mapping[str, TopicDraft]
    unwritten: tuple[str, ...] = ()
    unread: tuple[str, ...] = ()
    silent: tuple[str, ...] = ()
    peers: tuple[str, ...] = ()
    skipped: int = 0
    listener: bool = False


def plain_draft(
    facts: PlainFacts,
    *,
    unit: str | None = None,
    external: Collection[str] = (),
    names: Mapping[str, str] | None = None,
) -> PlainDraft:
    """Return the system that a graph and a recording show.

    Sessions of one process are one component. What is external is told as by `system_draft.sketch`.

    Args:
        facts: Observed facts about the system.
        unit: Component to test.
        external: Components that play the outside world.
        names: Names of components by the ids of their sessions, where they have some already.

    Raises:
        EnvironmentFaultError: Nothing was seen.
        ConfigError: A component that was named was not seen.
    """
    processes = sessions_by_process(facts.graph)
    if not processes and not facts.topics:
        raise EnvironmentFaultError(
            "neither components nor messages were seen",
            where=facts.where,
            hint="is it the endpoint of the router that they are connected to (-e)? Look longer with --seconds",
        )
    named = dict(names) if names else component_names(processes, facts.commands)
    uses = uses_of(facts.graph, named)
    groups = topic_groups(facts.graph, uses, facts.topics)
    topics = topics_by_name(groups, facts.topics)
    parts = [_part(named[each[0].zid], each[0].zid, uses, groups, topics) for each in processes]
    commands = {named[each[0].zid]: _command(facts, each) for each in processes}
    if not parts:
        parts, commands = [DraftComponent(_NAMELESS, (), "")], {_NAMELESS: unknown_command(_NOTHING)}
    system = described(parts, unit=unit, external=external)
    written = {used.topic for part in parts for used in part.outputs}
    read = {used.topic for part in parts for used in part.inputs}
    open_ends = {each.topic for each in facts.graph.edges if each.role == "subscribes" and not each.zid}
    # A topic with an unknown publisher is not known to come from outside.
    known = {topic: why for topic, why in system.external.items() if topic in written or topic not in topics}
    return PlainDraft(
        replace(system, external=known),
        commands,
        _segments({named[each[0].zid]: each[0].segment for each in processes}, system),
        named,
        groups,
        topics,
        unwritten=tuple(sorted(topics.keys() - written)),
        unread=tuple(sorted(name for name, keys in groups.items() if open_ends & set(keys) and name not in read)),
        silent=tuple(part.name for part in parts if not (part.inputs or part.outputs or part.services)),
        peers=tuple(named[each[0].zid] for each in processes if any(one.mode == "peer" for one in each)),
        skipped=facts.skipped,
        listener=facts.listener,
    )


def _part(
    name: str, zid: str, uses: Uses, groups: Mapping[str, list[str]], topics: Mapping[str, TopicDraft]
) -> DraftComponent:
    called = {key: topic for topic, keys in groups.items() for key in keys}

    def used(role: str) -> tuple[Used, ...]:
        names = sorted({called[key] for key in uses[name, role]})
        return tuple(Used(each, remark(topics.get(each), len(groups[each]))) for each in names)

    services = sorted(f"{role} {key}" for role in ("serves", "calls") for key in uses[name, role])
    return DraftComponent(name, (), zid, used("subscribes"), used("publishes"), tuple(services))


def _command(facts: PlainFacts, process: Sequence[ConnectedComponent]) -> CommandDraft:
    found = next((facts.commands[each.zid] for each in process if each.zid in facts.commands), None)
    return found or unknown_command(facts.no_command)


def _segments(homes: Mapping[str, str], system: SystemDraft) -> dict[str, str]:
    """Return the segment of each component: the router's, if these separate the outside, else one of two new ones."""
    outside, inside = (
        {homes.get(part.name, "") for part in system.parts if bool(part.external) is way} for way in (True, False)
    )
    if outside and inside and not outside & inside and "" not in outside | inside:
        return dict(homes)
    return {part.name: OUTSIDE if part.external else INSIDE for part in system.parts}


def sessions_by_process(graph: Graph) -> list[Process]:
    """Return the sessions of each component: those of one process belong together, and routers are left out."""
    found: defaultdict[Hashable, list[ConnectedComponent]] = defaultdict(list)
    for each in graph.components:
        if each.mode != "router":
            found[each.pid or each.zid].append(each)
    ordered = sorted(found.values(), key=lambda each: (each[0].segment, each[0].label, each[0].pid or 0, each[0].zid))
    return [tuple(each) for each in ordered]


def component_names(processes: Sequence[Process], commands: Mapping[str, CommandDraft]) -> dict[str, str]:
    """Return the name in riot.toml of the component of each session.

    That is its usual name; if several have the same one, the first word that only its command has is added.

    Args:
        processes: The sessions of each component.
        commands: Drafts of the components' commands, by the ids of their sessions.
    """
    called = [_short(process[0].label) for process in processes]
    words = [_words(process, commands) for process in processes]
    taken: set[str] = set()
    found: dict[str, str] = {}
    for number, process in enumerate(processes):
        twins = [words[other] for other, name in enumerate(called) if name == called[number] and other != number]
        own = next((word for word in words[number] if twins and not any(word in twin for twin in twins)), "")
        name = free_name(f"{called[number]}_{own}" if own else called[number], taken)
        found |= {each.zid: name for each in process}
    return found


def _short(label: str) -> str:
    """Return a program's name without its language and its package."""
    base = label.removesuffix(".py")
    return base.rpartition(".")[2] if _MODULE.fullmatch(base) else base


def _words(process: Process, commands: Mapping[str, CommandDraft]) -> list[str]:
    known = next((commands[each.zid] for each in process if each.zid in commands), None)
    return [word for word in known.command[1:] if _WORD.fullmatch(word)] if known is not None else []
