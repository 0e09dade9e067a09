"""The draft of a plain Zenoh system, from its graph and the messages that were seen; pure."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from riot_bus.draft.command_draft import unknown_command
from riot_bus.draft.model import CommandDraft, DraftComponent, SystemDraft, TopicDraft, Used, draft_of, free_name
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.selector import key_matches

if TYPE_CHECKING:
    from collections.abc import Collection, Hashable, Mapping, Sequence

    from riot_bus.graph.model import ConnectedComponent, Graph

_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
_MODULE = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+")
_ID = re.compile(r"[0-9]{1,20}|[0-9a-fA-F]{16,64}|[0-9a-fA-F]{8}(?:-[0-9a-fA-F]{4}){3}-[0-9a-fA-F]{12}")
_OF_TOPICS = ("publishes", "subscribes")

Process = tuple["ConnectedComponent", ...]
Uses = defaultdict[tuple[str, str], set[str]]
"""Keys by the name of a component and what it does with them (a `Role`)."""


@dataclass(frozen=True, slots=True)
class Seen:
    """Observed facts about a system, from a network or from a recording.

    Attributes:
        graph: Connected components, and what they publish and read, as far as that is known.
        topics: By key, what the messages reveal about the topic.
        commands: Drafts of the components' commands, by the id of their session.
        skipped: Number of keys that were not examined because there were too many.
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


def graph_draft(
    seen: Seen, *, unit: str | None = None, external: Collection[str] = (), names: Mapping[str, str] | None = None
) -> SystemDraft:
    """Return the system that a graph and messages show; sessions of one process are one component.

    Some components may have names already, by the ids of their sessions; for the unit and the external ones see
    `draft_of`.

    Raises:
        EnvironmentFaultError: Nothing was seen.
        ConfigError: A component that was named was not seen.
    """
    processes = sessions_by_process(seen.graph)
    if not processes and not seen.topics:
        raise EnvironmentFaultError(
            "neither components nor messages were seen",
            where=seen.where,
            hint="is it the endpoint of the router that they are connected to (-e)? Look longer with --seconds",
        )
    named = names or component_names(processes, seen.commands)
    uses = uses_of(seen.graph, named)
    groups = topic_groups(seen.graph, uses, seen.topics)
    topics = topics_by_name(groups, seen.topics)
    called = {key: topic for topic, keys in groups.items() for key in keys}

    def used(name: str, role: str) -> tuple[Used, ...]:
        used_topics = sorted({called[key] for key in uses[name, role]})
        return tuple(Used(each, remark(topics.get(each), len(groups[each]))) for each in used_topics)

    def part(process: Process) -> DraftComponent:
        name, zids = named[process[0].zid], tuple(each.zid for each in process)
        return DraftComponent(
            name=name,
            command=_known_command(process, seen.commands) or unknown_command(seen.no_command),
            zids=zids,
            inputs=used(name, "subscribes"),
            outputs=used(name, "publishes"),
            services=tuple(sorted(f"{role} {key}" for role in ("serves", "calls") for key in uses[name, role])),
            segment=process[0].segment,
            peer=any(each.mode == "peer" for each in process),
        )

    unknown = DraftComponent(name="component", command=unknown_command("nothing tells what components there are"))
    draft = draft_of([part(each) for each in processes] or [unknown], unit=unit, external=external)
    written = {each.topic for part in draft.parts for each in part.outputs}
    read = {each.topic for part in draft.parts for each in part.inputs}
    open_ends = {each.topic for each in seen.graph.edges if each.role == "subscribes" and not each.zid}
    return replace(
        draft,
        # A topic with an unknown publisher is not known to come from outside.
        external={each: why for each, why in draft.external.items() if each in written or each not in topics},
        groups=groups,
        topics=topics,
        unwritten=tuple(sorted(topics.keys() - written)),
        unread=tuple(sorted(name for name, keys in groups.items() if open_ends & set(keys) and name not in read)),
        skipped=seen.skipped,
        listener=seen.listener,
    )


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
    """
    called, words = [], []
    for process in processes:
        base = process[0].label.removesuffix(".py")
        called.append(base.rpartition(".")[2] if _MODULE.fullmatch(base) else base)
        known = _known_command(process, commands)
        words.append([word for word in known.command[1:] if _WORD.fullmatch(word)] if known is not None else [])
    taken: set[str] = set()
    found: dict[str, str] = {}
    for number, process in enumerate(processes):
        twins = [words[other] for other, name in enumerate(called) if name == called[number] and other != number]
        own = next((word for word in words[number] if twins and not any(word in twin for twin in twins)), "")
        name = free_name(f"{called[number]}_{own}" if own else called[number], taken)
        found |= {each.zid: name for each in process}
    return found


def _known_command(process: Process, commands: Mapping[str, CommandDraft]) -> CommandDraft | None:
    return next((commands[each.zid] for each in process if each.zid in commands), None)


def uses_of(graph: Graph, names: Mapping[str, str]) -> Uses:
    """Return the keys that each component uses; a key expression only if it includes none of these keys."""
    found: Uses = defaultdict(set)
    for edge in graph.edges:
        if edge.zid in names:
            found[names[edge.zid], edge.role].add(edge.topic)
    for keys in found.values():
        plain = {key for key in keys if "*" not in key}
        keys -= {each for each in keys - plain if any(key_matches(each, key) for key in plain)}
    return found


def topic_groups(graph: Graph, uses: Uses, topics: Mapping[str, TopicDraft]) -> dict[str, list[str]]:
    """Return all keys of topics by their names in the file: the adapters' names, else the key, or a key expression.

    A key expression stands for keys that differ by a number or id, have the same users, and messages of one kind.
    """
    users: defaultdict[str, set[tuple[str, str]]] = defaultdict(set)
    for (name, role), keys in uses.items():
        for key in keys if role in _OF_TOPICS else ():
            users[key].add((name, role))
    for edge in graph.edges:
        if not edge.zid and edge.role in _OF_TOPICS:
            users[edge.topic].add(("", edge.role))
    called = {each.key: each.name for each in graph.topics} | {key: each.topic for key, each in topics.items()}
    every = sorted({*topics, *users})

    def kind(key: str) -> Hashable:
        known = topics.get(key)
        what = (known.type_name, known.declare, known.fits, known.encodings) if known is not None else None
        return what, frozenset(users[key])

    found = grouped({key: kind(key) for key in every if called.get(key, key) == key}, every)
    for key in every:
        if (name := called.get(key, key)) != key:
            found.setdefault(name, []).append(key)
    return found


def topics_by_name(groups: Mapping[str, list[str]], topics: Mapping[str, TopicDraft]) -> dict[str, TopicDraft]:
    """Return what is known of the topics that had messages, by their names in the file."""
    found = {}
    for name, keys in groups.items():
        known = [topics[key] for key in keys if key in topics]
        if known:
            found[name] = replace(
                known[0],
                count=sum(each.count for each in known),
                rate=sum(each.rate for each in known),
                sizes=(min(each.sizes[0] for each in known), max(each.sizes[1] for each in known)),
                read=sum(each.read for each in known),
            )
    return found


def remark(topic: TopicDraft | None, keys: int = 1) -> str:
    """Return a remark on a topic, for a comment; None if no message was seen, and `keys` that it stands for."""
    if topic is None:
        return "no message was seen"
    words = (
        topic.type_name or "type unknown",
        encoding_of(topic),
        size_of(topic),
        f"{topic.rate:.3g}/s" if topic.rate else f"{topic.count} seen",
        f"{keys} keys" if keys > 1 else "",
    )
    return ", ".join(filter(None, words))


def encoding_of(topic: TopicDraft) -> str:
    """Return the most frequent encoding of a topic's messages; empty if they have none."""
    return next((each for each in topic.encodings if each), "")


def size_of(topic: TopicDraft) -> str:
    """Return how many bytes the payloads of a topic have."""
    least, most = topic.sizes
    return f"{least} to {most} bytes" if least != most else f"{most} byte{'s' if most != 1 else ''}"


def grouped(alike: Mapping[str, Hashable], others: Collection[str] = ()) -> dict[str, list[str]]:
    """Return keys by group: by the key itself, or by a key expression for several similar keys.

    An expression stands for keys that differ only by the number or id of one chunk and have the same properties, if it
    includes no other key. If several expressions fit a key, the one with most keys counts; if there is a tie, none.

    Args:
        alike: Properties of each key that must be the same within a group.
        others: Further existing keys, which are not grouped.

    Example:
        >>> grouped({"robot/1/pose": "json", "robot/2/pose": "json", "robot/2/map": "raw"})
        {'robot/*/pose': ['robot/1/pose', 'robot/2/pose'], 'robot/2/map': ['robot/2/map']}
    """
    families: defaultdict[tuple[str, Hashable], list[str]] = defaultdict(list)
    for key, what in alike.items():
        chunks = key.split("/")
        for number, chunk in enumerate(chunks):
            if _ID.fullmatch(chunk):
                families["/".join((*chunks[:number], "*", *chunks[number + 1 :])), what].append(key)
    every, sizes = {*alike, *others}, defaultdict[str, list[int]](list)
    clear = {}
    for (expression, _), keys in families.items():
        if len(keys) > 1 and not any(key_matches(expression, key) for key in every.difference(keys)):
            clear[expression] = keys
            for key in keys:
                sizes[key].append(len(keys))
    found = {
        expression: sorted(keys)
        for expression, keys in sorted(clear.items())
        if all(max(sizes[key]) == len(keys) and sizes[key].count(len(keys)) == 1 for key in keys)
    }
    taken = {key for keys in found.values() for key in keys}
    return {**found, **{key: [key] for key in alike if key not in taken}}
