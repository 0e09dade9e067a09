"""JSON payloads: scalars are read by the standard library and patched by splicing their span of text.

Keys that are not identifiers are quoted (`a["odd key"]`); a payload that is not an object is called `value`. The last
of duplicate keys counts, as in Python's `json`. Grammar: RFC 8259, plus the tokens NaN, Infinity and -Infinity.
"""

from __future__ import annotations

import json
import re
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from typing import Any

from riot_bus.types.capabilities import StandIn
from riot_bus.types.model import (
    MAX_DEPTH,
    REBUILD,
    ROOT,
    FieldPath,
    Leaf,
    Schema,
    check_leaves,
    check_size,
    member_path,
    parse_path,
    rebuilt,
    saturated,
    why_opaque,
    wrap_integer,
)
from riot_bus.vocabulary.errors import PayloadError, did_you_mean
from riot_bus.vocabulary.message import Scalar

_MAX_BYTES = 1 << 24  # parsed, small arrays and objects take some 30 times their size: about 500 MB
_INT64 = range(-(1 << 63), 1 << 63)  # larger integers are read as floats, as `Leaf` knows no wider type
_TOKEN = re.compile(r'"[^"\\]*+(?:\\.[^"\\]*+)*+"|[{}\[\],:]|[^\s{}\[\],:"]+')

_KINDS: dict[type, str] = {bool: "bool", int: "int64", float: "float64", str: "string"}
_STAND_INS = {"null": "null", "list": "[]", "map": "{}"}

Span = tuple[int, int]
"""Where a token or a container begins and ends in the text."""


class _Container:
    """An array or object, its span, and the nodes in it; a scalar's node is its span alone."""

    __slots__ = ("inside", "span")

    def __init__(self, span: Span, inside: dict[str, Node] | list[Node]) -> None:
        self.span, self.inside = span, inside


Node = Span | _Container


class JsonType:
    """Every JSON document: the payload describes itself."""

    name = "json"
    encoding = "json"
    schema: Schema | None = None

    def leaves(self, payload: bytes, *, elements: int = 16) -> Sequence[Leaf]:
        """List the scalar fields in payload order; `null` is not a field."""
        document = _parse(payload)[1]
        found: list[Leaf] = []
        _collect(document, "" if isinstance(document, dict) else ROOT, elements, 0, found)
        return found

    def opaque(self, payload: bytes) -> str | None:
        """Return why the payload cannot be decoded, None if it can."""
        return why_opaque(self, payload)

    def read(self, payload: bytes, path: str) -> Scalar:
        """Return one field's value (`len(path)` for the length of an array)."""
        field = parse_path(path)
        value = _walk(_parse(payload)[1], field, path)
        if field.length:
            if not isinstance(value, list):
                raise PayloadError("only arrays have a length", where=path)
            return len(value)
        return _scalar(value, path)

    def patch(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload with some scalars replaced; every byte outside of their tokens stays as it is.

        A float may be written into an integer field, since JSON does not distinguish them; integers wrap to 64 bits.
        """
        text, document = _parse(payload)
        root = _nodes(text)
        splices: dict[Span, str] = {}
        for path, value in changes.items():
            field = parse_path(path)
            if field.length:
                raise PayloadError("a length cannot be patched in place", where=path, hint=REBUILD)
            old = _scalar(_walk(document, field, path), path)
            splices[_span_of(_node_at(root, field))] = _token(old, value, path)
        for (start, end), token in sorted(splices.items(), reverse=True):
            text = text[:start] + token + text[end:]
        return text.encode()

    def rebuild(self, payload: bytes, changes: Mapping[str, Scalar]) -> bytes:
        """Return the payload with scalars and lengths of arrays changed; an empty array cannot grow."""
        return rebuilt(payload, changes, _resized, self.patch)

    def omit(self, payload: bytes, path: str, *, instead: StandIn | None = None) -> bytes:
        """Return the payload without a member of an object, or with a replacement for it."""
        text, document = _parse(payload)
        field = parse_path(path)
        _walk(document, field, path)
        if field.length:
            raise PayloadError("a length cannot be left out", where=path)
        start, end = _span_of(_node_at(_nodes(text), field))
        if instead:
            return (text[:start] + _STAND_INS[instead] + text[end:]).encode()
        tokens = [match.span() for match in _TOKEN.finditer(text)]
        at, behind = bisect_left(tokens, (start, 0)), bisect_left(tokens, (end, 0))
        if text[slice(*tokens[at - 1])] != ":":
            raise PayloadError("only members of an object can be left out", where=path)
        if text[slice(*tokens[behind])] == ",":
            start, end = tokens[at - 2][0], tokens[behind + 1][0]
        else:
            last = text[slice(*tokens[at - 3])] == ","
            start = tokens[at - 3 if last else at - 2][0]
        return (text[:start] + text[end:]).encode()


def _parse(payload: bytes) -> tuple[str, Any]:
    if len(payload) > _MAX_BYTES:
        raise PayloadError(f"JSON of {len(payload)} bytes is over the limit of {_MAX_BYTES}")
    try:
        text = payload.decode()
        return text, json.loads(text)
    except (ValueError, RecursionError) as error:
        raise PayloadError(f"not JSON: {error}") from error


def _walk(document: Any, field: FieldPath, path: str) -> Any:
    steps = field.steps
    if not isinstance(document, dict):
        if steps[0] != ROOT:
            raise PayloadError(f"the payload is not an object; its path begins with {ROOT!r}", where=path)
        steps = steps[1:]
    for step in steps:
        if isinstance(document, list) and isinstance(step, int):
            if not 0 <= step < len(document):
                raise PayloadError(f"no element {step} in an array of {len(document)}", where=path)
            document = document[step]
        elif isinstance(document, dict) and step in document:
            document = document[step]
        else:
            known = document if isinstance(document, dict) else ()
            raise PayloadError(f"no field {step!r}", where=path, hint=did_you_mean(str(step), known))
    return document


def _scalar(value: Any, path: str) -> Scalar:
    if isinstance(value, bool | float | str):
        return value
    if isinstance(value, int):
        return value if value in _INT64 else saturated(value)
    kind = "an object" if isinstance(value, dict) else "an array" if isinstance(value, list) else "null"
    raise PayloadError(f"{kind} is not a scalar field", where=path)


def _collect(value: Any, path: str, elements: int, depth: int, found: list[Leaf]) -> None:
    kind = type(value)
    if kind in _KINDS:
        if kind is int and value not in _INT64:
            kind, value = float, saturated(value)
        found.append(Leaf(path, _KINDS[kind], value))
        return
    if depth > MAX_DEPTH:
        raise PayloadError(f"JSON is nested deeper than {MAX_DEPTH}")
    check_leaves(len(found), elements)
    if isinstance(value, dict):
        for key, item in value.items():
            _collect(item, member_path(path, key), elements, depth + 1, found)
    elif isinstance(value, list):
        found.append(Leaf(f"len({path})", "uint32", len(value)))
        for index, item in enumerate(value[:elements]):
            _collect(item, f"{path}[{index}]", elements, depth + 1, found)


def _token(old: Scalar, new: Scalar, path: str) -> str:
    if isinstance(new, bytes):
        raise PayloadError("JSON has no bytes", where=path)
    if isinstance(new, int) and not isinstance(new, bool):
        new = saturated(new) if isinstance(old, float) else wrap_integer(new, bits=64, signed=True)
    return json.dumps(new)


def _nodes(text: str) -> Node:
    """Return the node of the document; `text` is known to be JSON."""
    root: list[Node] = []
    open_: list[_Container] = []
    key: str | None = None
    for match in _TOKEN.finditer(text):
        part = match.group()
        if part in ",:":
            continue
        if part in "]}":
            ended = open_.pop()
            ended.span = ended.span[0], match.end()
            continue
        inside = open_[-1].inside if open_ else root
        if isinstance(inside, dict) and key is None:
            key = json.loads(part)
            continue
        node: Node = match.span()
        if part in "{[":
            node = _Container(match.span(), {} if part == "{" else [])
            open_.append(node)
        if isinstance(inside, dict):
            inside[str(key)] = node
            key = None
        else:
            inside.append(node)
    return root[0]


def _node_at(node: Any, field: FieldPath) -> Any:
    """Return the node of a field that the document is known to have."""
    in_object = isinstance(node, _Container) and isinstance(node.inside, dict)
    for step in field.steps if in_object else field.steps[1:]:
        node = node.inside[step]
    return node


def _span_of(node: Node) -> Span:
    return node.span if isinstance(node, _Container) else node


def _resized(payload: bytes, path: str, count: int) -> bytes:
    """Return the document with an array of `count` elements: truncated, or with its last element repeated."""
    text, document = _parse(payload)
    field = parse_path(path)
    array = _walk(document, field, path)
    if not isinstance(array, list):
        raise PayloadError("only arrays have a length", where=path)
    elements = [_span_of(node) for node in _node_at(_nodes(text), field).inside]
    if count > len(elements):
        if not elements:
            raise PayloadError("nothing tells what the elements of an empty array are", where=path)
        start, end = elements[-1]
        comma = text[elements[-2][1] : start] if len(elements) > 1 else ","
        more = comma + text[start:end]
        check_size(len(payload) + (count - len(elements)) * len(more.encode()), path)
        return (text[:end] + more * (count - len(elements)) + text[end:]).encode()
    if count == len(elements):
        return payload
    start = elements[count - 1][1] if count else elements[0][0]
    return (text[:start] + text[elements[-1][1] :]).encode()
