"""Messages of another shape: arrays of other lengths, old stamps, and malformed payloads."""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING

from riot_bus.campaign.targets import any_names, may_change, samples_by_topic
from riot_bus.campaign.variations import Variation
from riot_bus.types.brittle import STAMPS, why_brittle
from riot_bus.types.capabilities import OmitsFields
from riot_bus.types.model import Leaf, MessageType, member_path, parse_path
from riot_bus.vocabulary.errors import PayloadError
from riot_bus.vocabulary.injection import Injection

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message, Scalar

_LATER_ELEMENT = re.compile(r"\[[1-9]\d*\]")
_LONG = 1000
"""Added elements of a long array: more than most buffers hold, though each may have kilobytes."""
_NULL = (("null", True),)
_LIST, _MAP = (("empty", "list"),), (("empty", "map"),)


def malformations(
    messages: Sequence[Message], registry: TypeRegistry, *, leave: Sequence[str] = (), include: Sequence[str] = ()
) -> list[Variation]:
    """Return the ways to change the shape of a log's messages, as variations to try once.

    Arrays are empty, one shorter, one longer and long; that is malformed where the format has no definition and all
    messages have one length. All stamps of a message are those of the topic's first message, of its last one, or of one
    just before it.
    Malformed are payloads that are cut off, and in formats without a definition of the fields, each field, list and map
    that is missing, null or of another type. Of an array's elements, only the first is changed.

    Topics none of whose fields may be changed are left alone, too.
    """
    found = []
    longest, fixed = Counter[str](), fixed_lengths(messages, registry)
    for message in messages:
        topic = registry.topic(message.key)
        longest[topic] = max(longest[topic], len(message.payload))
    for topic, (count, samples) in samples_by_topic(messages, registry).items():
        fields: dict[str, tuple[MessageType, Leaf]] = {}
        inside: dict[str, tuple[OmitsFields, bytes, list[str]]] = {}
        middle = len(samples) // 2
        stamps: list[dict[str, Scalar]] = [{}, {}, {}]
        for number, sample in enumerate(samples):
            kind, payload = sample
            leaves = sample.leaves(elements=1)
            for leaf in leaves:
                if leaf.path not in fields and isinstance(kind, OmitsFields):
                    for outer in _outer(leaf.path):
                        inside.setdefault(outer, (kind, payload, []))[2].append(leaf.path)
                fields.setdefault(leaf.path, (kind, leaf))
            for at, place in enumerate((0, len(samples) - 1, middle - 1)):
                if number == place:
                    now = {leaf.path: leaf.value for leaf in leaves if why_brittle(leaf.path, kind) in STAMPS}
                    stamps[at] = {path: value for path, value in now.items() if not any_names(leave, topic, path)}
        for path, (kind, leaf) in fields.items():
            if may_change(topic, path, leave, include, kind=kind) and not _LATER_ELEMENT.search(path):
                malformed = (topic, path) in fixed if path.startswith("len(") else isinstance(kind, OmitsFields)
                changes = _of_field(topic, kind, leaf)
                found += [Variation(topic, (each,), f"{topic} {path}", malformed=malformed) for each in changes]
        for outer, (omitting, payload, paths) in inside.items():
            left = any(any_names(leave, topic, path) for path in (outer, *paths)) or _LATER_ELEMENT.search(outer)
            if not left and any(may_change(topic, path, leave, include) for path in paths):
                array = f"len({outer})" in fields
                faults = _of_container(topic, omitting, payload, outer, array=array)
                found += [Variation(topic, (each,), f"{topic} {outer}", malformed=True) for each in faults]
        step = max(1, count // max(1, len(samples)))
        for each in stamps if len(samples) > 1 and stamps[0] != stamps[1] else ():
            injections = tuple(Injection(topic, path, value) for path, value in each.items())
            found.append(Variation(topic, injections, f"{topic} stamps", 1, min(count - 1, middle * step)))
        most = 0 if any_names(leave, topic, "") else longest[topic]
        sizes = {int(keep * most): Injection(topic, fault="truncate", options=(("keep", keep),)) for keep in (0.5, 0.0)}
        cuts = (each for size, each in sizes.items() if size < most)
        found += [Variation(topic, (each,), f"{topic} truncate", malformed=True) for each in cuts]
    return found


def fixed_lengths(messages: Sequence[Message], registry: TypeRegistry) -> set[tuple[str, str]]:
    """Return topics and paths (`len(data)`) of arrays without a definition that always have the same length."""
    lengths: dict[tuple[str, str], set[Scalar]] = {}
    for topic, (_, samples) in samples_by_topic(messages, registry).items():
        for sample in samples:
            for leaf in sample.leaves(elements=1) if isinstance(sample.kind, OmitsFields) else ():
                if leaf.path.startswith("len("):
                    lengths.setdefault((topic, leaf.path), set()).add(leaf.value)
    return {place for place, known in lengths.items() if len(known) == 1}


def _of_field(topic: str, kind: MessageType, leaf: Leaf) -> Iterator[Injection]:
    if leaf.path.startswith("len("):
        now = int(leaf.value)
        for length in sorted({0, now - 1, now + 1, now + _LONG} - {-1}):
            yield Injection(topic, leaf.path, length)
    elif isinstance(kind, OmitsFields):
        if not leaf.path.endswith("]") or leaf.path.endswith('"]'):
            yield Injection(topic, leaf.path, fault="omit")
        for options in (_NULL, _LIST, _MAP):
            yield Injection(topic, leaf.path, fault="omit", options=options)
        yield Injection(topic, leaf.path, 1 if leaf.type in ("string", "bytes") else "1")


def _of_container(topic: str, kind: OmitsFields, payload: bytes, path: str, *, array: bool) -> Iterator[Injection]:
    """Yield the ways to malform a list or a map of a payload as a whole."""
    try:
        kind.omit(payload, path)
    except PayloadError:  # an element of a list cannot be left out
        pass
    else:
        yield Injection(topic, path, fault="omit")
    for options in (_NULL, _MAP) if array else (_NULL, _LIST, _MAP):
        yield Injection(topic, path, fault="omit", options=options)


def _outer(path: str) -> Iterator[str]:
    """Yield the paths of the lists and maps that contain a field; for a list's length, the list itself is the last."""
    field, name = parse_path(path), ""
    for step in field.steps if field.length else field.steps[:-1]:
        name = f"{name}[{step}]" if isinstance(step, int) else member_path(name, step)
        yield name
