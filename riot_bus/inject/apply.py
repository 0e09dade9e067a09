"""Inject into a log: the same pipeline as on the live bus, with the log's own time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riot_bus.inject.interceptor import Injector
from riot_bus.pipeline.queue import EmissionQueue
from riot_bus.pipeline.runner import Pipeline
from riot_bus.vocabulary.errors import RiotError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from riot_bus.pipeline.event import Change
    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.injection import Injection
    from riot_bus.vocabulary.message import Message


def inject_log(
    messages: Sequence[Message],
    injections: Sequence[Injection],
    *,
    registry: TypeRegistry,
    seed: int = 0,
    reached: list[list[int]] | None = None,
    ahead: list[int] | None = None,
) -> tuple[tuple[Message, ...], list[tuple[int, Message, tuple[Change, ...]]]]:
    """Apply injections to a log, in the order of its messages.

    Args:
        messages: Messages of the log.
        injections: Injections to carry out on them.
        registry: Registry that names topics and knows their types.
        seed: Seed of the random choices.
        reached: List to which are added, for each injection, the indices of the messages that it changed; setting a
            field to the value that it already has is not a change.
        ahead: List to which is added, for each message of the log, how many messages come out before its turn.

    Returns:
        The messages as a receiver would get them (a delayed one carries its new time), and for every touched message
        its index in the log, the original and what was done to it.
    """
    injector = Injector(injections, seed=seed)
    pipeline = Pipeline([injector], registry=registry)
    hits = injector.hits.copy()
    if reached is not None:
        reached.extend([] for _ in injections)
    queue = EmissionQueue()
    out: list[Message] = []
    touched: list[tuple[int, Message, tuple[Change, ...]]] = []
    for index, message in enumerate(messages):
        if ahead is not None:
            ahead.append(len(out))
        if not queue and pipeline.passes(message):
            out.append(message)
            continue
        result = pipeline.feed(message)
        queue.push(*result.emissions)
        out.extend(each.message_when_due() for each in queue.pop_due(message.time))
        if result.changes:
            touched.append((index, message, result.changes))
            if reached is not None:
                for number in changed_by(injections, injector.hits - hits, result.changes):
                    reached[number].append(index)
                hits = injector.hits.copy()
    out.extend(each.message_when_due() for each in queue.pop_due())
    pipeline.close()
    for name, errors in pipeline.errors.items():
        raise RiotError(f"{name} failed on {errors.count} messages:\n{errors.first}")
    return tuple(out), touched


def changed_by(injections: Sequence[Injection], applied: Iterable[int], changes: Iterable[Change]) -> Iterator[int]:
    """Yield the numbers of the injections that changed a message; setting a field to its own value is not a change."""
    real = {each.field for each in changes if repr(each.before) != repr(each.after)}
    same = {each.field for each in changes if each.action == "set"} - real
    yield from (number for number in applied if injections[number].field not in same)
