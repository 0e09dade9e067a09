"""Definitions of ROS 2 interfaces from text: .msg, .srv, .action and .idl files, and the schemas of logs.

rosbags parses; this module adds what its version 0.11 lacks: `wstring`, services and actions with the messages that
rosidl makes of them, and limits for untrusted text.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from rosbags.interfaces.typing import Constdefs, Fielddefs

    Definition = tuple[Constdefs, Fielddefs]

KINDS = ("msg", "srv", "action")
_BASE, _NAME, _ARRAY, _SEQUENCE = range(1, 5)  # rosbags' Nodetype
MOST_TEXT = 1 << 20  # bounds the parser's time for any text of a node or file; Jazzy's longest have 4 kB
_DIVIDER = re.compile(r"^---[ \t]*$", re.MULTILINE)
_SECTION = re.compile(r"^=+\n(?:MSG|IDL): *(\S+)[ \t]*\n", re.MULTILINE)
_EVENT = re.compile(r"(\w+/srv/\w+)_Event")
TYPE_NAME = re.compile(r"[A-Za-z]\w*(?:/[A-Za-z]\w*)+", re.ASCII)
_PART = re.compile(
    r"_(?:(?:SendGoal|GetResult)(?:_(?:Request|Response|Event))?|Goal|Result|Feedback|FeedbackMessage"
    r"|Request|Response|Event)$"
)
_WSTRING = re.compile(r"^([ \t]*wstring)<=([0-9]{1,10})\b", re.MULTILINE)
_WIDE = re.compile(r".*/wstring(?:_([0-9]+))?")
_DIRECTIVE = re.compile(r"^[ \t]*#.*$", re.MULTILINE)
_IDL_TEXT = re.compile(r'"(?:\\.|[^"\\])*"|/\*.*?\*/|//[^\n]*', re.DOTALL)
_IDL_COSTLY = re.compile(r"<<|\([^()]*\(")
_INFO: Any = (_NAME, "service_msgs/msg/ServiceEventInfo")
_GOAL_ID: Any = (_NAME, "unique_identifier_msgs/msg/UUID")
_STAMP: Any = (_NAME, "builtin_interfaces/msg/Time")


class DefinitionError(Exception):
    """A definition's text does not parse."""


class Field(NamedTuple):
    """One field.

    Attributes:
        content: Base type such as `float64`, or a message type's name.
        length: Length of an array; None for a sequence.
        most: Upper bound of a sequence's length; 0 if there is none.
        most_bytes: Upper bound of a string's length; 0 if there is none.
    """

    name: str
    content: str
    is_message: bool
    is_array: bool = False
    length: int | None = None
    most: int = 0
    most_bytes: int = 0


def fields_of(definition: Definition) -> Iterator[Field]:
    """Yield the fields of a definition in order."""
    for name, (kind, content) in definition[1]:
        inner: Any = (kind, content)
        size = 0
        if kind >= _ARRAY:
            inner, size = content[0], int(content[1])
        is_message = inner[0] == _NAME
        base, most_bytes = (inner[1], 0) if is_message else inner[1]
        length, most = (size, 0) if kind == _ARRAY else (None, size)
        yield Field(name, base, is_message, kind >= _ARRAY, length, most, most_bytes)


def references(definition: Definition) -> Iterator[str]:
    """Yield the names of the message types that a definition's fields have."""
    return (field.content for field in fields_of(definition) if field.is_message)


def interface_of(name: str) -> str:
    """Return the interface that a message belongs to.

    Example:
        >>> interface_of("tf2_msgs/action/LookupTransform_SendGoal_Request")
        'tf2_msgs/action/LookupTransform'
    """
    return _PART.sub("", name) if name.split("/")[1:2] in (["srv"], ["action"]) else name


def normal_name(name: str) -> str:
    """Return `pkg/msg/Name` for `pkg/Name` too."""
    package, slash, rest = name.partition("/")
    return name if not slash or "/" in rest else f"{package}/msg/{rest}"


def parse_file(text: str, name: str, suffix: str) -> dict[str, Definition]:
    """Parse the text of an interface's file.

    Returns:
        The definitions by name; for services and actions, all messages that rosidl makes of them.

    Raises:
        DefinitionError: The text does not parse, or does not define what the file's name says.
    """
    parse = {".msg": parse_msg, ".srv": _parse_srv, ".action": _parse_action}.get(suffix)
    found = parse_idl(text) if parse is None else parse(text, name)
    expected = {"srv": f"{name}_Request", "action": f"{name}_Goal"}.get(name.split("/")[1], name)
    if expected not in found:
        raise DefinitionError(f"does not define {expected}")
    return found


def parse_recorded(text: str, name: str) -> dict[str, Definition]:
    """Parse a log's `ros2msg` schema: a definition and its dependencies.

    For service events, rosbag2 writes the text of the .srv file. Raises DefinitionError.
    """
    text = text.replace("\r\n", "\n")
    event = _EVENT.fullmatch(name)
    dependencies = _SECTION.search(text)
    head = text[: dependencies.start()] if dependencies else text
    if event is not None and _DIVIDER.search(head) is not None:
        found = parse_msg(text[len(head) :], "a/msg/B")
        del found["a/msg/B"]
        return found | _parse_srv(head, event[1])
    found = parse_msg(text, name)
    if "/msg/" in name:
        return found
    interface = interface_of(name)  # its parts are named like messages: see `schema_text`
    chunks = interface.split("/")
    if len(chunks) != 3:
        raise DefinitionError(f"{name!r} is not the name of a type")
    package, kind, short = chunks
    part = re.compile(rf"{re.escape(package)}/msg/({re.escape(short)}_\w+)")

    def rename(each: str) -> str:
        return part.sub(lambda match: f"{package}/{kind}/{match[1]}", each)

    return {rename(each): (found[each][0], [_mended(field, rename) for field in found[each][1]]) for each in found}


def parse_msg(text: str, name: str) -> dict[str, Definition]:
    """Parse a .msg file, with dependencies after lines of `=`; raises DefinitionError."""
    from rosbags.typesys import get_types_from_msg

    package, _, short = normal_name(name).rpartition("/")
    spelled = f"{package.split('/')[0]}/msg/{short}"  # in a .srv too, bare names are messages of the package
    text = _WSTRING.sub(r"\1_\2", text.replace("\r\n", "\n"))
    found = _parsed(lambda text: get_types_from_msg(text, spelled), text)
    return {normal_name(name) if each == spelled else each: found[each] for each in found}


def parse_idl(text: str) -> dict[str, Definition]:
    """Parse an .idl file, or a log's `ros2idl` schema: sections, each after a line of `=` and its name.

    Raises:
        DefinitionError: The text does not parse, or has nested parentheses or shifts, which are too slow in rosbags.
    """
    from rosbags.typesys import get_types_from_idl

    found: dict[str, Definition] = {}
    for section in _SECTION.split(_DIRECTIVE.sub("", text.replace("\r\n", "\n")))[::2]:
        if _IDL_COSTLY.search(_IDL_TEXT.sub(" ", section)):
            raise DefinitionError("nested parentheses and shifts are not supported")
        if section.strip():
            found |= _parsed(get_types_from_idl, section)
    for name in [*found]:
        if name.endswith("_Request") and "/srv/" in name:
            found |= _service(name.removesuffix("_Request"))
        elif name.endswith("_Goal") and "/action/" in name:
            found |= _action(name.removesuffix("_Goal"))
    return found


def _parsed(parse: Callable[[str], Any], text: str) -> dict[str, Definition]:
    from rosbags.typesys import TypesysError

    if len(text) > MOST_TEXT:
        raise DefinitionError(f"text of {len(text)} characters is over the limit of {MOST_TEXT}")
    try:
        parsed: Mapping[str, Definition] = parse(text)
    except (TypesysError, RecursionError, ValueError, LookupError, TypeError, ArithmeticError, AttributeError) as error:
        raise DefinitionError(str(error)) from error
    found = {
        _respelled(name): (list(each[0]), [_mended(field, _respelled) for field in each[1]])
        for name, each in parsed.items()
    }
    odd = next((name for name in found if TYPE_NAME.fullmatch(name) is None), None)
    if odd is not None:
        raise DefinitionError(f"{odd!r} is not the name of a type")
    return found


def _mended(field: Any, rename: Callable[[str], str]) -> Any:
    """Return a field with `wstring` as a base type, and with renamed types."""
    name, (kind, content) = field
    if kind >= _ARRAY:
        return name, (kind, (_mended((name, content[0]), rename)[1], content[1]))
    if kind == _NAME:
        wide = _WIDE.fullmatch(content)
        return name, ((_BASE, ("wstring", int(wide[1] or 0))) if wide else (_NAME, rename(content)))
    return field


def _respelled(name: str) -> str:
    """Return `pkg/srv/Name` for rosbags' form of it, `pkg/srv/msg/Name`."""
    return re.sub(r"/srv/msg/", "/srv/", name)


def _parse_srv(text: str, name: str) -> dict[str, Definition]:
    return _parts(text, name, ("Request", "Response")) | _service(name)


def _parse_action(text: str, name: str) -> dict[str, Definition]:
    return _parts(text, name, ("Goal", "Result", "Feedback")) | _action(name)


def _parts(text: str, name: str, suffixes: tuple[str, ...]) -> dict[str, Definition]:
    texts = _DIVIDER.split(text.replace("\r\n", "\n"))
    if len(texts) != len(suffixes):
        wanted = f"{len(suffixes)} ({', '.join(suffixes)})"
        raise DefinitionError(f"has {len(texts)} parts instead of {wanted}; a line '---' separates two parts")
    found: dict[str, Definition] = {}
    for part, suffix in zip(texts, suffixes, strict=True):
        found |= parse_msg(part, f"{name}_{suffix}")
    return found


def _service(name: str) -> dict[str, Definition]:
    """Return what rosidl adds to a service: its event, and the combination of all three that is hashed for keys."""
    request, response, event = (f"{name}_{part}" for part in ("Request", "Response", "Event"))
    return {
        event: _message(info=_INFO, request=_one_at_most(request), response=_one_at_most(response)),
        name: _message(
            request_message=(_NAME, request), response_message=(_NAME, response), event_message=(_NAME, event)
        ),
    }


def _action(name: str) -> dict[str, Definition]:
    """Return what rosidl adds to an action: two services and the message with the feedback."""
    goal, result, feedback = f"{name}_SendGoal", f"{name}_GetResult", f"{name}_FeedbackMessage"
    return {
        f"{goal}_Request": _message(goal_id=_GOAL_ID, goal=(_NAME, f"{name}_Goal")),
        f"{goal}_Response": _message(accepted=(_BASE, ("bool", 0)), stamp=_STAMP),
        **_service(goal),
        f"{result}_Request": _message(goal_id=_GOAL_ID),
        f"{result}_Response": _message(status=(_BASE, ("int8", 0)), result=(_NAME, f"{name}_Result")),
        **_service(result),
        feedback: _message(goal_id=_GOAL_ID, feedback=(_NAME, f"{name}_Feedback")),
        name: _message(
            goal=(_NAME, f"{name}_Goal"), result=(_NAME, f"{name}_Result"), feedback=(_NAME, f"{name}_Feedback"),
            send_goal_service=(_NAME, goal), get_result_service=(_NAME, result), feedback_message=(_NAME, feedback),
        ),
    }  # fmt: skip


def _message(**fields: Any) -> Definition:
    return [], list(fields.items())


def _one_at_most(name: str) -> Any:
    return _SEQUENCE, ((_NAME, name), 1)
