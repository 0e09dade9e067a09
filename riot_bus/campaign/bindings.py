"""Fields and messages of a log to which the tables of a dictionary file apply, and tables that never can."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.campaign.groups import groups_of, parts_by_topic
from riot_bus.campaign.targets import Target, targets_of
from riot_bus.inject.dictionary import Dictionary
from riot_bus.inject.dictionary_file import DictionaryFile, binds, eligible, plain_value
from riot_bus.types.model import family_of
from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.vocabulary.field_pattern import names_field

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message


@dataclass(frozen=True, slots=True)
class AppliesTo:
    """Fields or messages to which a table of a dictionary file applies.

    Attributes:
        fields: `topic:path` of fields, or of messages that are mutated; `[*]` for the elements of an array.
        left_alone: `topic:path` of further fields or messages that campaigns leave alone.
    """

    fields: tuple[str, ...]
    left_alone: tuple[str, ...]


def never_applied(
    dictionary: Dictionary, messages: Sequence[Message], registry: TypeRegistry, fields: Mapping[str, Iterable[Target]]
) -> Iterator[ConfigError]:
    """Yield an error for each of the user's own tables that can never apply.

    A field or a message counts if it is in the log, left alone or not.

    Raises:
        ConfigError: A mutation names a field that its type does not have.
    """
    own = dictionary.own()
    yield from own.unmatched(f"{each.topic}:{each.path}" for found in fields.values() for each in found)
    tables: dict[str, set[str]] = {}
    for name in own.mutated_types():
        for mutation in own.mutations_for(name):
            tables.setdefault(mutation.source, set()).add(name)
    if not tables:
        return
    groups = groups_of(messages, registry, own, include=["*"])
    made = {one.mutation.source for found in groups.values() for some in found.values() for one in some}
    types = {part.type_name for found in parts_by_topic(messages, registry).values() for part in found}
    for where, names in tables.items():
        if names.isdisjoint(types):
            told = " or ".join(sorted(names))
            problem, hint = f"no message of the log is or holds a {told}", did_you_mean(min(names), types)
        else:
            problem, hint = "none of its mutations changes a message of the log", "do these messages have the fields?"
        if where not in made:
            yield ConfigError(problem, where=where, hint=hint)


def naming_nothing(patterns: Iterable[str], fields: Mapping[str, Iterable[Target]]) -> list[str]:
    """Return the patterns (`topic:path`) that name no field of a log, no length of one, and no topic's messages."""
    names = {f"{topic}:" for topic in fields} | {_name(each) for found in fields.values() for each in found}

    def named(pattern: str) -> bool:
        topic, colon, path = family_of(pattern).rpartition(":")
        paths = [f"{path[4:-1]}[*]", path[4:-1]] if path.startswith("len(") else [path]
        return any(names_field(f"{topic}{colon}{each}", name) for each in paths for name in names)

    return [pattern for pattern in patterns if not named(pattern)]


def misfits(text: str, where: str, messages: Sequence[Message], registry: TypeRegistry) -> list[ConfigError]:
    """Return what is wrong with a dictionary file (exceptional values for fields and types) if a log is tested with it.

    These are tables that apply to no field or message of the log, mutations of fields that do not exist, and values
    that a field's type cannot hold. Each is told once.

    Raises:
        ConfigError: The file is wrong for any log: not TOML, or an unknown key or type.
    """
    dictionary = Dictionary()
    dictionary.add(text, where=where, own=True)
    fields_by_topic = targets_of(messages, registry, include=["*"])
    found: list[ConfigError] = []
    try:
        for problem in never_applied(dictionary, messages, registry, fields_by_topic):
            found.append(problem)  # noqa: PERF402 - extend() would lose those that are yielded before one is raised
    except ConfigError as error:
        found.append(error)
    for target in (each for fields in fields_by_topic.values() for each in fields):
        try:
            dictionary.values_for(target.type, f"{target.topic}:{target.path}")
        except ConfigError as error:
            found.append(error)
    return list({str(each): each for each in found}.values())


def applied(
    file: DictionaryFile,
    text: str,
    messages: Sequence[Message],
    registry: TypeRegistry,
    *,
    leave: Sequence[str] = (),
    include: Sequence[str] = (),
) -> dict[str, AppliesTo]:
    """Return what each table of a file (`entry[0]`, `field[0]`, `message[0]`, ...) applies to in a log."""
    every = [each for found in targets_of(messages, registry, include=["*"]).values() for each in found]
    chosen = {each for found in targets_of(messages, registry, leave=leave, include=include).values() for each in found}
    tables: dict[str, list[tuple[str, bool]]] = {}
    for number, entry in enumerate(file.entry):
        kind, value = entry.type or file.type, plain_value(entry.value)
        holding = (each for each in every if (each.type == kind if kind else eligible(each.type, value)))
        tables[f"entry[{number}]"] = [(_name(each), each in chosen) for each in holding]
    for number, binding in enumerate(file.field):
        patterns = [family_of(pattern) for pattern in binding.patterns]
        bound = (each for each in every if any(binds(one, f"{each.topic}:{each.path}") for one in patterns))
        tables[f"field[{number}]"] = [(_name(each), each in chosen) for each in bound]
    dictionary = Dictionary()
    dictionary.add(text, where="")
    groups = groups_of(messages, registry, dictionary, leave=leave, include=include)
    parts = parts_by_topic(messages, registry)
    for number, message in enumerate(file.message):
        types = {message.type} if isinstance(message.type, str) else set(message.type)
        tables[f"message[{number}]"] = [
            (f"{topic}:{part.path}".rstrip(":"), f": message[{number}] at {part.path}" in groups.get(topic, {}))
            for topic, found in parts.items()
            for part in found
            if part.type_name in types
        ]
    return {name: _sorted_out(rows) for name, rows in tables.items()}


def _name(target: Target) -> str:
    return f"{target.topic}:{family_of(target.path)}"


def _sorted_out(rows: Iterable[tuple[str, bool]]) -> AppliesTo:
    found: dict[str, bool] = {}
    for name, chosen in rows:
        found[name] = found.get(name, False) or chosen
    return AppliesTo(
        tuple(name for name, chosen in found.items() if chosen),
        tuple(name for name, chosen in found.items() if not chosen),
    )
