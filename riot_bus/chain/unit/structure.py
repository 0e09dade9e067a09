"""Search for what a failure needs besides values: keys, the order of messages, times between them.

All keys are left out or put back at once, then all neighbours swapped, then all gaps lengthened. The parts that must
not change are found like the needed messages of a log, each with two logs that differ in this part alone.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Literal

from riot_bus.chain.base.logs import FailingLog, NamedField, NamedFields
from riot_bus.generalize.minimize import minimize
from riot_bus.generalize.oracle import same_scalar
from riot_bus.statistics.noise import Noise
from riot_bus.types.capabilities import OmitsFields
from riot_bus.vocabulary.errors import InconclusiveError, PayloadError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Ask, Progress

_TOGETHER = (("key", "missing key", "no value"), ("order",), ("gap",))
"""Kinds that are changed at once; swapped neighbours with swapped keys would be the same again."""

_Messages = list["Message"]
_Changed = Callable[[Collection[int]], FailingLog]


@dataclass(frozen=True, slots=True)
class Part:
    """A property of a log, other than a value, that the failure may need, and the function that changes it.

    Attributes:
        kind: `key`: a map in a payload (JSON, CBOR, ...) has this key; `missing key`: it lacks keys that it had before
            the injection; `no value`: such keys are there without a value, as null or an empty list; `order`: two
            neighbouring messages come in this order; `gap`: the time between two neighbours is no longer than it is.
        name: Path of the key or keys, as `topic:path`; for `order` and `gap` the first message, as `topic`. It is
            `topic[i]` instead of `topic` if the log has several messages of the topic.
        change: Function that changes the property in a list of messages, in place: it omits the key, puts missing keys
            or values back, swaps the two messages, or lengthens the gap.
    """

    kind: Literal["key", "missing key", "no value", "order", "gap"]
    name: str
    then: str
    change: Callable[[_Messages], None]


@dataclass(frozen=True, slots=True)
class Needed:
    """One part that has to stay as it is: a log that fails, and the same log with this part changed, which passes."""

    part: Part
    failing: FailingLog
    passing: FailingLog


@dataclass(frozen=True, slots=True)
class Structure:
    """What was found.

    Attributes:
        asked: Number of parts for which this was decided, by kind; 0 if trials did not decide.
        failed: Numbers of failed and of all trials with the other parts of a kind changed at once.
    """

    needed: tuple[Needed, ...]
    asked: Mapping[str, int]
    failed: tuple[int, int]


def parts_of(
    fields: NamedFields, considered: Sequence[NamedField], known: Collection[str], *, paced: bool
) -> list[Part]:
    """Return what can be changed in a log besides values."""
    messages, names = fields.log.messages, fields.log.names(fields.registry)
    parts = [*_missing(fields, names), *_keys(considered, known)]
    parts += [
        Part("order", names[place], names[place + 1], partial(_swap, place))
        for place, (before, after) in enumerate(pairwise(messages))
        if before.digest() != after.digest() and place not in fields.orders.values()  # asked like fields
    ]
    gaps = range(len(messages) - 1) if paced else ()
    return [*parts, *(Part("gap", names[place], names[place + 1], partial(_lengthen, place)) for place in gaps)]


def search_structure(
    log: FailingLog,
    parts: Sequence[Part],
    ask: Ask[FailingLog],
    *,
    noise: Noise,
    budget: int,
    parallelism: int,
    progress: Progress | None,
) -> Structure:
    """Find the parts that have to stay as they are."""
    needed: list[Needed] = []
    asked: dict[str, int] = {part.kind: 0 for part in parts}
    failed = total = 0
    for kinds in _TOGETHER:
        some = [part for part in parts if part.kind in kinds]

        def changed(kept: Collection[int], some: Sequence[Part] = some) -> FailingLog:
            messages = list(log.messages)
            for place, part in enumerate(some):
                if place not in kept:
                    part.change(messages)
            return FailingLog(tuple(messages), log.originals)

        def fails(questions: Sequence[tuple[int, ...]], changed: _Changed = changed) -> Sequence[bool]:
            return ask([changed(kept) for kept in questions])

        if not some or budget <= 0:
            continue
        try:
            found = minimize(len(some), fails, noise=noise, budget=budget, parallelism=parallelism, progress=progress)
        except InconclusiveError:
            continue
        budget -= found.trials
        if found.one_minimal:
            failing = changed(found.kept)
            needed += [Needed(some[place], failing, changed({*found.kept} - {place})) for place in found.kept]
            asked |= Counter[str](part.kind for part in some)
            if len(found.kept) < len(some):  # else nothing was changed in these trials
                failed, total = failed + found.failed[0], total + found.failed[1]
    return Structure(tuple(needed), asked, (failed, total))


def _keys(considered: Sequence[NamedField], known: Collection[str]) -> Iterator[Part]:
    for field in considered:
        kind: object = field.kind
        if field.name in known or not isinstance(kind, OmitsFields):
            continue
        try:
            kind.omit(field.payload, field.leaf.path)
        except PayloadError:  # an element of an array, or a length
            continue
        yield Part("key", field.name, "", partial(_omit, field.position, kind, field.leaf.path))


def _missing(fields: NamedFields, names: Sequence[str]) -> Iterator[Part]:
    """Yield, for each message that lacks values of its original, the part that puts them back."""
    for place, message in enumerate(fields.log.messages):
        before = fields.log.originals.get(message.sequence)
        kind: object = fields.registry.type_of_message(message)
        if before is None or not isinstance(kind, OmitsFields):
            continue
        try:
            now = {leaf.path: leaf.value for leaf in kind.leaves(message.payload)}  # type: ignore[attr-defined]
            was = {leaf.path: leaf.value for leaf in kind.leaves(before.payload)}  # type: ignore[attr-defined]
            lacking = [path for path in was if path not in now]
            values = {path: value for path, value in now.items() if path in was and not same_scalar(value, was[path])}
            payload = kind.rebuild(before.payload, values) if values else before.payload  # type: ignore[attr-defined]
        except PayloadError:
            continue
        if lacking:
            there = any(_is_there(kind, message.payload, path) for path in lacking)
            name = f"{names[place]}:{', '.join(lacking)}"
            yield Part("no value" if there else "missing key", name, "", partial(_put_back, place, payload))


def _is_there(kind: OmitsFields, payload: bytes, path: str) -> bool:
    """Return whether a payload has a key, though it may hold no value."""
    try:
        kind.omit(payload, path)
    except PayloadError:
        return False
    return True


def _omit(place: int, kind: OmitsFields, path: str, messages: _Messages) -> None:
    messages[place] = messages[place].with_payload(kind.omit(messages[place].payload, path))


def _put_back(place: int, payload: bytes, messages: _Messages) -> None:
    messages[place] = messages[place].with_payload(payload)


def _swap(place: int, messages: _Messages) -> None:
    first, second = messages[place : place + 2]
    messages[place : place + 2] = [second.with_(time=first.time), first.with_(time=second.time)]


def _lengthen(place: int, messages: _Messages) -> None:
    gap = messages[place + 1].time - messages[place].time
    more = max(1_000_000_000, 9 * gap)  # at least a second longer, and ten times as long
    messages[place + 1 :] = [message.with_(time=message.time + more) for message in messages[place + 1 :]]
