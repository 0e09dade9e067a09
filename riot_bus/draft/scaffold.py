"""Drafts of a system as riot.toml, with comments on what is left to fill in, and as JSON or text.

A system of ROS 2 nodes is drafted from what they announce (`sketch_toml`), a plain Zenoh system from its graph and a
short recording (`draft_toml`).
"""

from __future__ import annotations

import shlex
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from riot_bus.draft.plain_topics import size_of
from riot_bus.draft.system_draft import INSIDE, OUTSIDE
from riot_bus.vocabulary.redaction import escape_control_chars as comment
from riot_bus.vocabulary.text_table import table_lines
from riot_bus.vocabulary.toml_text import toml_string, toml_value

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from riot_bus.draft.plain_draft import PlainDraft
    from riot_bus.draft.system_draft import DraftComponent, SystemDraft
    from riot_bus.draft.topic_look import TopicDraft

PROGRAM = ("ros2", "run", "PACKAGE", "EXECUTABLE")
"""Placeholder for the command of a component, which a network does not reveal."""
_MARK = "FILL IN"
_KEYS = "All keys: docs/riot-toml.md."
_MOST_NAMED = 12  # topics in one comment: at about 20 letters each, a line of 240


def sketch_json(found: SystemDraft) -> dict[str, Any]:
    """Return the sketch as JSON's kinds of values."""
    return {
        "components": [
            {
                **{name: value for name, value in asdict(part).items() if name != "external"},
                "segment": _segment(part),
                "external": bool(part.external),
                "why_external": part.external,
            }
            for part in found.parts
        ],
        "external": dict(found.external),
        "unit": found.unit,
        "unknown_types": list(found.unknown),
    }


def sketch_toml(found: SystemDraft, *, origin: str) -> str:
    """Return the text of a system file for ROS 2 nodes.

    Args:
        found: The system.
        origin: Place and way of the observation, for the first comment.
    """
    outside = _external(
        found.external,
        given=f"What the outside world controls. {_MARK}: take out what it does not.",
        none=(
            f"{_MARK}: no node was seen that only publishes; name those that play the outside world with",
            "--external NODE, or write here what the outside controls. Without it the chain ends with the rule.",
        ),
        example=f'"/topic:field.*" = [-1.0, 1.0]   # {_MARK}: values that the outside can take',
    )
    log = '# log = "nominal.mcap"   # a recording of its inputs; without it, the system is run to make one'
    units = [f"[unit.{part.name}]\n{log}" for part in found.parts if _is_tested(part, found.unit)]
    parts = [_node_component(part, bridged=found.bridged) for part in found.parts]
    return "\n\n".join([_nodes_head(found, origin), *parts, outside, *units]) + "\n"


def draft_toml(found: PlainDraft, *, origin: str, name: str, nominal: str | None = None) -> str:
    """Return the text of a system file.

    Args:
        found: The system.
        origin: Place and way of the observation, for the first comment.
        name: Name of the system.
        nominal: Path of its nominal log.
    """
    parts, unit = found.system.parts, found.system.unit
    # Runs of the whole system change messages key by key, so what is external is named by keys.
    keys = {key: why for topic, why in found.system.external.items() for key in found.groups.get(topic, [topic])}
    outside = _external(
        keys,
        given="What the outside world controls; take out what it does not.",
        none=["Nothing is known to come from outside; without topics here the chain ends with the rule."],
        more=[
            f"# {toml_string(topic)} was published by an unknown component: {_MARK} which one it is."
            for topic in found.unwritten
        ],
        example='"key:field.*" = [-1.0, 1.0]   # values that the outside can take',
    )
    units = [f"[unit.{part.name}]" for part in parts if _is_tested(part, unit)]
    units = units or [f"# [unit.NAME]   # {_MARK}: the component that is to be tested"]
    blocks = [_head(found, origin, name, nominal), _types(found), *(_component(part, found) for part in parts)]
    return "\n\n".join(filter(None, [*blocks, outside, *units])) + "\n"


def left_to_fill_in(found: PlainDraft) -> list[str]:
    """Return what the file marks with FILL IN, in a line each, with its place."""
    lines = [f"types: {topic}: {_type_unknown(known)}" for topic, known in _unclear(found)]
    for part in found.system.parts:
        lines += [f"components.{part.name}: {each}" for each in found.commands[part.name].missing]
        if part.name in found.silent:
            lines.append(f"components.{part.name}: what it reads and writes")
    lines += [f"external: who publishes {topic}" for topic in found.unwritten]
    if not any(_is_tested(part, found.system.unit) for part in found.system.parts):
        lines.append("unit: the component that is to be tested")
    return lines


def draft_json(found: PlainDraft) -> dict[str, Any]:
    """Return the draft as JSON's kinds of values."""
    return {
        "components": [
            {
                "name": part.name,
                "segment": found.segments[part.name],
                "command": list(found.commands[part.name].command),
                "cwd": found.commands[part.name].cwd,
                "env": dict(found.commands[part.name].env),
                "pid": found.commands[part.name].pid or None,
                "inputs": [each.topic for each in part.inputs],
                "outputs": [each.topic for each in part.outputs],
                "services": list(part.services),
                "external": bool(part.external),
                "why_external": part.external,
            }
            for part in found.system.parts
        ],
        "topics": {
            name: {
                "keys": list(found.groups[name]),
                "type": each.type_name or None,
                "fits": list(each.fits),
                "encodings": list(each.encodings),
                "messages": each.count,
                "rate": round(each.rate, 3),
                "bytes": list(each.sizes),
            }
            for name, each in found.topics.items()
        },
        "external": dict(found.system.external),
        "unit": found.system.unit,
        "unknown_publisher": list(found.unwritten),
        "unknown_receiver": list(found.unread),
        "skipped": found.skipped,
        "listener": found.listener,
        "units": [part.name for part in found.system.parts if _is_tested(part, found.system.unit)],
        "fill_in": left_to_fill_in(found),
    }


def draft_lines(found: Mapping[str, Any]) -> list[str]:
    """Return a draft as text: its components, what is external, what is left to fill in, and what to do next.

    Args:
        found: As `draft_json` returns it, and whether components were `started`.
    """
    parts = found["components"]
    rows = [
        (
            part["name"],
            part["segment"],
            f"{len(part['inputs'])} in, {len(part['outputs'])} out  {shlex.join(part['command'])}",
        )
        for part in parts
    ]
    lines = table_lines(rows, left=range(3))
    lines.append(f"external topics: {', '.join(found['external']) or 'none known'}")
    lines += [f"{topic}: type unknown" for topic, each in found["topics"].items() if not each["type"]]
    if found["unknown_publisher"]:
        lines.append(f"published by an unknown component: {', '.join(found['unknown_publisher'])}")
    if found["unknown_receiver"]:
        lines.append(f"read by an unknown component: {', '.join(found['unknown_receiver'])}")
    if found["skipped"]:
        lines.append(f"{found['skipped']} more keys were too many to look at")
    if any(topic.startswith("/") for topic in found["topics"]):
        lines.append("there are ROS 2 nodes: riot init --ros2 tells more of them")
    if found["listener"]:
        lines.append("a component reads everything, such as a recorder, which hides what the others read")
    lines += [f"FILL IN {each}" for each in found["fill_in"]]
    silent = any(not (part["inputs"] or part["outputs"]) for part in parts)
    if not found["started"] and silent and any(part["pid"] for part in parts):
        lines.append("--start starts each component once, on a segment of its own, and sees what it reads and writes")
    elif not found["fill_in"]:
        choose = f" --unit {found['units'][0]}" if len(found["units"]) > 1 else ""
        lines.append(f"nothing is left to fill in; next: riot test{choose}")
    return [comment(line) for line in lines]


def _is_tested(part: DraftComponent, unit: str | None) -> bool:
    """Return whether a component gets a table as a unit: the chosen one, else all that read something inside."""
    return part.name == unit if unit is not None else bool(part.inputs) and not part.external


def _opening(origin: str, note: str, name: str, segments: Sequence[str]) -> list[str]:
    """Return the first comments of a file, and the first keys of `[system]`."""
    return [
        f"# Written by `riot init`: {comment(origin)}.",
        f"# {note}",
        "",
        "[system]",
        f"name = {toml_string(name)}",
        f"segments = {toml_value(segments)}",
    ]


def _rows(items: Iterable[tuple[str, str]]) -> list[str]:
    """Return the lines of a list of texts in TOML, each with its comment in one column."""
    rows = [(f"    {toml_string(text)},", remark) for text, remark in items]
    width = max((len(row) for row, _ in rows), default=0)
    return [f"{row:{width}}   # {comment(remark)}" if remark else row for row, remark in rows]


def _usage(part: DraftComponent) -> list[str]:
    """Return the lines on what a component reads and writes, with types as comments, and its other uses."""
    lines = []
    for key, used in (("inputs", part.inputs), ("outputs", part.outputs)):
        if rows := _rows((each.topic, ", ".join(filter(None, (each.type_name, each.qos)))) for each in used):
            lines += [f"{key} = [", *rows, "]"]
    for what, names in (("Services", part.services), ("Actions", part.actions)):
        if names:
            lines.append(f"# {what}, which are not tested: {comment(', '.join(names))}.")
    return lines


def _external(
    topics: Mapping[str, str], *, given: str, none: Sequence[str], example: str, more: Sequence[str] = ()
) -> str:
    """Return the table of what is external.

    Args:
        topics: External topics, each with why it is thought to be one.
        given: Comment on these topics.
        none: Comment if there are no topics.
        example: Example of a range.
        more: Further lines.
    """
    found = [f"# {given}", "topics = [", *_rows(topics.items()), "]"]
    if not topics:
        found = [*(f"# {line}" for line in none), "topics = []"]
    return "\n".join(["[external]", *found, *more, "", "# [external.ranges]", f"# {example}"])


def _nodes_head(found: SystemDraft, origin: str) -> str:
    note = f"What a network cannot tell is marked with {_MARK}. {_KEYS}"
    lines = [
        *_opening(origin, note, "ros2", [OUTSIDE, INSIDE]),
        '# sources = ["src/**/*.py"]   # FILL IN: the code under test; without it, stored trials outlive its changes',
        f'adapters = ["{"ros2dds" if found.bridged else "ros2"}"]',
    ]
    if found.unknown:
        lines.append("# FILL IN: no definition of these types was found, so their fields are unknown:")
        lines += [f"#   {comment(name)}" for name in found.unknown]
        lines.append('# messages = ["my_msgs/msg/Name.msg"]')
    types = {used.topic: used.type_name for part in found.parts for used in (*part.inputs, *part.outputs)}
    if found.bridged and types:
        lines += ["", "[system.types]"]
        lines += [
            f"{toml_string(topic)} = {toml_string(name)}"
            for topic, name in sorted(types.items())
            if name not in found.unknown
        ]
    return "\n".join(lines)


def _node_component(part: DraftComponent, *, bridged: bool) -> str:
    lines = [f"[components.{part.name}]"]
    if len(part.nodes) > 1:
        lines.append(f"# One process with several nodes: {comment(', '.join(part.nodes))}.")
    if not part.nodes:
        lines.append("# A bridge to DDS: FILL IN a command that starts it, and the ROS nodes behind it.")
    if part.started is not None:
        lines.append(
            f"# As process {part.started.pid} was started. FILL IN what has to be different when riot starts it."
        )
        lines.append(f"command = {toml_value(part.started.command)}")
        lines.append(f"cwd = {toml_string(part.started.cwd)}")
        if part.only:
            lines.append(f"only = {toml_string(part.only)}")
    elif not part.nodes:
        lines.append(f"command = {toml_value(PROGRAM)}")
    else:
        lines.append("# FILL IN: how to start it (one process, not `ros2 launch` of the whole system).")
        lines.append(f"command = {toml_value((*PROGRAM, *_remaps(part)))}")
    if part.dds:
        lines.append("dds = true")
    elif part.nodes:
        from riot_bus.control.environment import environment

        settings = environment(["{endpoint}"], "rmw_zenoh")
        inside = ", ".join(f"{name} = {toml_string(value)}" for name, value in settings.items())
        lines.append(f"env = {{ {inside} }}")
    lines.append(f'segment = "{_segment(part)}"')
    if part.external:
        lines.append(f"external = true   # {comment(part.external)}; put it {INSIDE} if that is wrong")
    return "\n".join([*lines, *_usage(part)])


def _remaps(part: DraftComponent) -> list[str]:
    if len(part.nodes) != 1:
        return []
    namespace, _, name = part.nodes[0].rpartition("/")
    words = ["--ros-args", "-r", f"__node:={name}"]
    return [*words, "-r", f"__ns:={namespace}"] if namespace else words


def _segment(part: DraftComponent) -> str:
    return OUTSIDE if part.external else INSIDE


def _head(found: PlainDraft, origin: str, name: str, nominal: str | None) -> str:
    segments = list(dict.fromkeys(found.segments.values()))
    if set(segments) <= {OUTSIDE, INSIDE}:
        segments = [OUTSIDE, INSIDE]
    lines = _opening(origin, _KEYS, name, segments)
    if nominal is not None:
        lines.append(f"nominal = {toml_string(nominal)}")
    named = sorted(
        {
            each
            for topic in found.topics.values()
            for each in topic.encodings
            if "protobuf" in each and not topic.type_name
        }
    )
    if named:
        lines.append(f"# {_MARK}: descriptor sets that define what is published as {comment(', '.join(named))}:")
        lines.append('# messages = ["NAME.desc"]')
    if found.skipped:
        lines.append(f"# {found.skipped} more keys were too many to look at.")
    return "\n".join(lines)


def _types(found: PlainDraft) -> str:
    """Return the table of types that must be declared or are unknown; empty if there are none."""
    rows = []
    for topic, known in found.topics.items():
        if known.declare:
            why = f"all {known.read} payloads read so, but {_encoded(known)}"
            rows.append(f"{toml_string(topic)} = {toml_string(known.type_name)}   # {comment(why)}")
    for topic, known in _unclear(found):
        guess = known.fits[0] if known.fits else "raw"
        rows.append(f"# {toml_string(topic)} = {toml_string(guess)}   # {_MARK}: {comment(_type_unknown(known))}")
    return "\n".join(["[system.types]", *rows]) if rows else ""


def _unclear(found: PlainDraft) -> Iterator[tuple[str, TopicDraft]]:
    """Yield the topics of unknown type that had nonempty payloads."""
    for topic, known in found.topics.items():
        if not known.type_name and known.sizes[1]:
            yield topic, known


def _type_unknown(topic: TopicDraft) -> str:
    if topic.fits:
        return f"{' or '.join(topic.fits)}? all {topic.read} payloads, of {size_of(topic)}, can be read so"
    encoding = next((each for each in topic.encodings if each), "")
    told = f"{encoding}, " if encoding else ""
    return f"{told}{size_of(topic)}: no codec reads them; a packed structure is raw(float32 x, uint8 mode)"


def _encoded(topic: TopicDraft) -> str:
    encoding = next((each for each in topic.encodings if each), "")
    return f"their encoding is {encoding}" if encoding else "they have no encoding"


def _component(part: DraftComponent, found: PlainDraft) -> str:
    runs = found.commands[part.name]
    lines = [f"[components.{part.name}]"]
    lines += [f"# {_MARK}: {comment(each)}." for each in runs.missing]
    told = f"   # as process {runs.pid} was started" if runs.pid else ""
    lines.append(f"command = {toml_value(runs.command)}{told}")
    if runs.cwd != ".":
        lines.append(f"cwd = {toml_string(runs.cwd)}")
    if runs.env:
        lines.append(f"env = {toml_value(runs.env)}")
    lines.append(f"segment = {toml_string(found.segments[part.name])}")
    if part.name in found.peers:
        lines.append("# A Zenoh peer: without multicast scouting, else it also finds what runs beside its trials.")
    if part.external:
        inside = f"; put it {INSIDE} if that is wrong" if found.segments[part.name] == OUTSIDE else ""
        lines.append(f"external = true   # {comment(part.external)}{inside}")
    if part.name in found.silent:
        lines.append(f"# {_MARK}: what it reads and writes, as inputs and outputs; nothing tells{_open(found)}.")
    return "\n".join([*lines, *_usage(part)])


def _open(found: PlainDraft) -> str:
    topics = list(dict.fromkeys([*found.unwritten, *found.unread]))
    if not topics:
        return ""
    more = f" and {len(topics) - _MOST_NAMED} more" if len(topics) > _MOST_NAMED else ""
    return f". The components of these topics are unknown: {comment(', '.join(topics[:_MOST_NAMED]))}{more}"
