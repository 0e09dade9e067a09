"""Names of the keys of a plain Zenoh system in a system file, in groups of similar ones, and remarks on each; pure."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import replace
from typing import TYPE_CHECKING

from riot_bus.vocabulary.selector import key_matches

if TYPE_CHECKING:
    from collections.abc import Collection, Hashable, Mapping

    from riot_bus.draft.topic_look import TopicDraft
    from riot_bus.graph.model import Graph

Uses = defaultdict[tuple[str, str], set[str]]
"""Keys by the name of a component and what it does with them (a `Role`)."""
_OF_TOPICS = ("publishes", "subscribes")
_ID = re.compile(r"[0-9]{1,20}|[0-9a-fA-F]{16,64}|[0-9a-fA-F]{8}(?:-[0-9a-fA-F]{4}){3}-[0-9a-fA-F]{12}")


def uses_of(graph: Graph, names: Mapping[str, str]) -> Uses:
    """Return the keys that each component uses; a key expression only if it includes none of these keys.

    Args:
        graph: Graph of components and topics.
        names: Name of the component of each session.
    """
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

    Args:
        graph: Graph with the adapters' names of keys.
        uses: Keys that each component uses.
        topics: Known facts about keys that had messages.
    """
    users: defaultdict[str, set[tuple[str, str]]] = defaultdict(set)
    for (name, role), keys in uses.items():
        for key in keys if role in _OF_TOPICS else ():
            users[key].add((name, role))
    for edge in graph.edges:
        if not edge.zid:
            users[edge.topic].add(("", edge.role))
    called = {each.key: each.name for each in graph.topics} | {key: each.topic for key, each in topics.items()}
    every = {*topics, *(key for key, roles in users.items() if any(role in _OF_TOPICS for _, role in roles))}

    def kind(key: str) -> Hashable:
        known = topics.get(key)
        what = (known.type_name, known.declare, known.fits, known.encodings) if known is not None else None
        return what, frozenset(users[key])

    found: dict[str, list[str]] = grouped(
        {key: kind(key) for key in sorted(every) if called.get(key, key) == key}, every
    )
    for key in sorted(every):
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


def size_of(topic: TopicDraft) -> str:
    """Return how many bytes the payloads of a topic have."""
    least, most = topic.sizes
    return f"{least} to {most} bytes" if least != most else f"{most} byte{'s' if most != 1 else ''}"


def remark(topic: TopicDraft | None, keys: int = 1) -> str:
    """Return a remark on a topic, for a comment.

    Args:
        topic: Known facts about the topic; None if no message was seen.
        keys: Number of keys that it stands for.
    """
    if topic is None:
        return "no message was seen"
    return ", ".join(
        filter(
            None,
            (
                topic.type_name or "type unknown",
                next((each for each in topic.encodings if each), ""),
                size_of(topic),
                f"{topic.rate:.3g}/s" if topic.rate else f"{topic.count} seen",
                f"{keys} keys" if keys > 1 else "",
            ),
        )
    )


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
