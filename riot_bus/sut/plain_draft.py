"""A first system file of a plain Zenoh system, from its graph and a short recording; pure."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from riot_bus.sut.command_draft import unknown_command
from riot_bus.sut.plain_parts import component_names, sessions_by_process
from riot_bus.sut.plain_topics import remark, topic_groups, topics_by_name, uses_of
from riot_bus.sut.system_draft import INSIDE, OUTSIDE, DraftComponent, SystemDraft, Used, described
from riot_bus.vocabulary.errors import EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from riot_bus.graph.model import ConnectedComponent, Graph
    from riot_bus.sut.command_draft import CommandDraft
    from riot_bus.sut.plain_topics import Uses
    from riot_bus.sut.topic_look import TopicDraft

__all__ = ["PlainDraft", "PlainFacts", "plain_draft"]

_NAMELESS, _NOTHING = "component", "nothing tells what components there are"


@dataclass(frozen=True, slots=True)
class PlainFacts:
    """What was seen of a system.

    Attributes:
        graph: Who is connected, and who publishes and reads what, as far as that is known.
        topics: What messages tell of their topics, by key.
        commands: How components are started, by the id of their session.
        skipped: Number of keys that were too many to look at.
        where: Names the network or the log in errors.
        no_command: Why a component has no command here.
        listener: Whether somebody reads everything, so that who else reads what does not show.
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
    """A system as far as it shows.

    Attributes:
        system: Components, with what they read and write, and what is external.
        commands: How each is started, by its name.
        segments: Where each is, by its name, and whether external ones have a segment of their own.
        sessions: The name of each session's component.
        groups: What inputs and outputs call topics: themselves, or key expressions of several.
        topics: What is known of each topic that was seen, by what `groups` call it.
        unwritten: Topics that had messages, by nobody that is known.
        unread: Topics that somebody reads, and nobody knows who.
        silent: Components of which nothing is known that they read or write.
        peers: Components that are peers, and may find others around a router.
        skipped, listener: As of `PlainFacts`.
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
        facts: What was seen of the system.
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
    # Of a topic that somebody publishes who is not known, it is not known either that the outside does.
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
    """Return the segment of each component: the router's, if those keep the outside apart, else two new ones."""
    outside, inside = (
        {homes.get(part.name, "") for part in system.parts if bool(part.external) is way} for way in (True, False)
    )
    if outside and inside and not outside & inside and "" not in outside | inside:
        return dict(homes)
    return {part.name: OUTSIDE if part.external else INSIDE for part in system.parts}
