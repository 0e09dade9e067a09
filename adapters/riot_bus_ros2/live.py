"""Definitions from nodes: the service `<node>/get_type_description`, which nodes can have since Iron.

Source: REP 2016, and `type_description_interfaces`. A node's definition is accepted if it has the key's hash.
"""

from __future__ import annotations

import os
import re
import time
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.errors import PayloadError
from riot_bus_ros2.attachment import Attachment, build_attachment, parse_attachment
from riot_bus_ros2.definitions import TYPE_NAME, DefinitionError, references
from riot_bus_ros2.gid import gid_of
from riot_bus_ros2.hashes import BASE_IDS, BOUNDED, COLLECTIONS, NESTED, type_hash
from riot_bus_ros2.keys import parse_data_key
from riot_bus_ros2.tokens import NodeEndpoint, parse_token

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from typing import Literal

    from riot_bus.types.capabilities import Ask
    from riot_bus_ros2.definitions import Definition
    from riot_bus_ros2.store import TypeStore

    Version = Literal[1, 2]

SERVICE = "type_description_interfaces/srv/GetTypeDescription"
_ENDING = "/get_type_description"
_MOST_NODES = 8  # a node that does not answer takes 2 s (`_ANSWER_S` of riot_bus.zenoh.type_learner)
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)
_BASES = {number: base for base, number in BASE_IDS.items() if base != "char"}
_TEXTS = {number: base for base, number in BOUNDED.items()}


def ask_nodes(
    name: str, wanted: str, services: Mapping[str, Version], ask: Ask, store: TypeStore
) -> dict[str, Definition]:
    """Ask nodes for a type, one after the other; return nothing if none knows it."""
    payload = question(name, wanted, store)
    for service, version in list(services.items())[:_MOST_NODES]:
        attachment = build_attachment(Attachment(1, time.time_ns(), os.urandom(16), version))
        for reply in ask(service, payload, attachment):
            try:
                return described(reply, name, wanted, store)
            except (PayloadError, DefinitionError):
                continue
    return {}


def services_of(key: str, tokens: Iterable[str], heard: Iterable[bytes]) -> dict[str, Version]:
    """Return the type description services of nodes that publish on a key, each with its attachment version.

    A node may crash if it gets an attachment of another version than its own. So only nodes of known version are asked:
    by a message with the gid of one of its publishers, or because it alone publishes on the key.

    Args:
        heard: Attachments of messages of this key.
    """
    topic = parse_data_key(key)
    said = _said(heard)
    if topic is None or not said:
        return {}
    marks = f"/{topic.topic.replace('/', '%')}/", f"{_ENDING.replace('/', '%')}/"  # most tokens need no parsing
    likely = {each: parse_token(each) for each in sorted(tokens) if any(mark in each for mark in marks)}
    endpoints = {each: found for each, found in likely.items() if isinstance(found, NodeEndpoint)}
    publishers = {each: found.node for each, found in endpoints.items() if (found.kind, found.key) == ("MP", key)}
    nodes = {node: said[gid] for each, node in publishers.items() if (gid := gid_of(each)) in said}
    if not nodes and len(set(publishers.values())) == 1 and len(set(said.values())) == 1:
        nodes = dict.fromkeys(publishers.values(), *set(said.values()))
    return {
        each.key: nodes[each.node]
        for each in endpoints.values()
        if each.kind == "SS" and each.type_name == SERVICE and each.node in nodes
        if each.topic == each.node.name + _ENDING
    }


def _said(heard: Iterable[bytes]) -> dict[bytes, Version]:
    """Return the version of attachments by the publisher's gid."""
    found: dict[bytes, Version] = {}
    for data in heard:
        try:
            attachment = parse_attachment(data)
        except PayloadError:
            continue
        found[attachment.gid] = attachment.version
    return found


def question(name: str, wanted: str, store: TypeStore) -> bytes:
    """Return the payload of a request that does not ask for the source texts of definitions."""
    from riot_bus_ros2.cdr import CdrType

    empty = b"\0\1\0\0" + bytes(9)  # two texts and a boolean
    return CdrType(f"{SERVICE}_Request", store).rebuild(empty, {"type_name": name, "type_hash": wanted})


def described(reply: bytes, name: str, wanted: str, store: TypeStore) -> dict[str, Definition]:
    """Return the definitions that a reply holds: of the type, and of all types in it.

    Raises:
        PayloadError: It is not a reply of this service.
        DefinitionError: The node does not know the type, or the description is not complete, or has another hash.
    """
    message = store.decode(reply, f"{SERVICE}_Response")
    if not message.successful:
        raise DefinitionError(f"the node does not know {name}: {message.failure_reason[:200]}")
    description = message.type_description
    parts = (description.type_description, *description.referenced_type_descriptions)
    found: dict[str, Definition] = {}
    for each in parts:
        fields = [(_checked(field.name, _NAME), _type(field.type)) for field in each.fields]
        found[_checked(each.type_name, TYPE_NAME)] = [], fields
    if name not in found or any(reference not in found for each in found.values() for reference in references(each)):
        raise DefinitionError(f"the description of {name} is not complete")
    told = type_hash(name, found)
    if told != wanted:
        raise DefinitionError(f"the description of {name} has another hash: {told}")
    return found


def _type(kind: Any) -> Any:
    number, capacity = int(kind.type_id), int(kind.capacity)
    collection, base = next(
        ((each, number - offset) for each, offset in reversed(COLLECTIONS.items()) if number > offset), ("", number)
    )
    inner: Any
    if base == NESTED:
        inner = (2, _checked(kind.nested_type_name, TYPE_NAME))
    elif base in _BASES:
        inner = (1, (_BASES[base], 0))
    elif base in _TEXTS:
        inner = (1, (_TEXTS[base], int(kind.string_capacity)))
    else:
        raise DefinitionError(f"unknown number of a type: {number}")
    if not collection:
        return inner
    return (3 if collection == "array" else 4), (inner, 0 if collection == "sequence" else capacity)


def _checked(name: str, pattern: re.Pattern[str]) -> str:
    if pattern.fullmatch(name) is None:
        raise DefinitionError(f"{name[:200]!r} is not a name")
    return name
