"""Places in a log where mutations of dictionaries apply: messages of their types, at any nesting level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.campaign.targets import ELEMENTS, MOST_ADDED_BYTES, may_change, samples_by_topic, spread
from riot_bus.inject.mutations import Mutation, mutate
from riot_bus.types.capabilities import DescribesFields, ListsParts, MessagePart
from riot_bus.types.model import family_of
from riot_bus.vocabulary.errors import ConfigError, PayloadError, did_you_mean
from riot_bus.vocabulary.injection import Injection

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from riot_bus.inject.dictionary import Dictionary
    from riot_bus.types.model import MessageType
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message

_MOST_PLACES = ELEMENTS**2  # as many elements in each of two nested arrays; each multiplies the mutations


@dataclass(frozen=True, slots=True)
class Group:
    """A mutation at one place in the messages of a topic.

    Attributes:
        base: Path of the nested message that is mutated; empty for the whole message.
        messages: Number of messages of the topic.
        most: Largest number of them to mutate at once, so that growing arrays fit into memory.
    """

    topic: str
    base: str
    mutation: Mutation
    messages: int
    most: int

    def injections(self, first: int, last: int, *, seed: int) -> list[Injection]:
        """Return the injections that change all fields in the messages `first` to `last` of the topic."""
        return [
            Injection(self.topic, path, value, first=first, last=last, seed=seed)
            for path, value in self.mutation.at(self.base)
        ]


def groups_of(
    messages: Sequence[Message],
    registry: TypeRegistry,
    dictionary: Dictionary,
    *,
    leave: Sequence[str] = (),
    include: Sequence[str] = (),
) -> dict[str, dict[str, list[Group]]]:
    """List the mutations that can be made in a log, by topic and by what they contradict.

    Fields that match `leave` are left alone; brittle ones and those of `opt_in` mutations have to match `include`.

    Raises:
        ConfigError: A mutation of the user's names a field that its type does not have.
    """
    groups: dict[str, dict[str, list[Group]]] = {}
    for topic, (count, samples) in samples_by_topic(messages, registry).items():
        for kind, payloads in _by_type(samples):
            for part in _parts(kind):
                for mutation in dictionary.mutations_for(part.type_name):
                    asked = mutation.opt_in
                    _check(mutation, part, kind)
                    for base in _places(part.path, kind, payloads):
                        paths = [path for path, _ in mutation.at(base)]
                        if not all(may_change(topic, p, leave, include, kind=kind, asked=asked) for p in paths):
                            continue
                        growth = _growth(mutation, base, kind, payloads)
                        if growth is not None:
                            most = max(1, min(count, MOST_ADDED_BYTES // max(1, growth)))
                            family = f"{mutation.source} at {part.path}"
                            group = Group(topic, base, mutation, count, most)
                            groups.setdefault(topic, {}).setdefault(family, []).append(group)
    return groups


def parts_by_topic(messages: Sequence[Message], registry: TypeRegistry) -> dict[str, list[MessagePart]]:
    """Return for each topic its messages and the messages nested in them, each with path and type."""
    samples = {topic: some for topic, (_, some) in samples_by_topic(messages, registry).items()}
    return {topic: [part for kind, _ in _by_type(some) for part in _parts(kind)] for topic, some in samples.items()}


def _by_type(samples: Iterable[tuple[MessageType, bytes]]) -> Iterable[tuple[MessageType, list[bytes]]]:
    found: dict[str, tuple[MessageType, list[bytes]]] = {}
    for kind, payload in samples:
        found.setdefault(kind.name, (kind, []))[1].append(payload)
    return found.values()


def _parts(kind: MessageType) -> Sequence[MessagePart]:
    if not isinstance(kind, ListsParts):
        return [MessagePart("", kind.name)]
    try:
        return kind.parts()
    except PayloadError:
        return []


def _check(mutation: Mutation, part: MessagePart, kind: MessageType) -> None:
    if not mutation.own or not isinstance(kind, DescribesFields):
        return
    known = {family_of(field.path) for field in kind.fields()}
    for path, _ in mutation.at(part.path):
        if family_of(path) not in known:
            hint = did_you_mean(path, known)
            raise ConfigError(f"{kind.name} has no field {path!r}", where=mutation.source, hint=hint)


def _places(path: str, kind: MessageType, payloads: Sequence[bytes]) -> Iterator[str]:
    """Yield the path with numbers in place of `[*]`: a few elements, from the first to the last of a sample."""
    pending, found = [path], 0
    while pending and found < _MOST_PLACES:
        each = pending.pop(0)
        head, star, tail = each.partition("[*]")
        if not star:
            found += 1
            yield each
            continue
        length = max((_length(kind, payload, head) for payload in payloads), default=0)
        pending += [f"{head}[{index}]{tail}" for index in spread(length, ELEMENTS)]


def _length(kind: MessageType, payload: bytes, path: str) -> int:
    try:
        return int(kind.read(payload, f"len({path})"))
    except PayloadError:
        return 0


def _growth(mutation: Mutation, base: str, kind: MessageType, payloads: Sequence[bytes]) -> int | None:
    """Return the largest number of bytes that a mutation adds to a message; None if it changes none of the samples."""
    growth: int | None = None
    for payload in payloads:
        try:
            mutated = mutate(kind, payload, mutation.at(base))
        except PayloadError:
            continue
        if mutated != payload:
            growth = max(growth or 0, len(mutated) - len(payload))
    return growth
