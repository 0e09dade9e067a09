"""Drafts of a system as riot.toml, with comments on what is left to fill in, and as JSON or text."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from riot_bus.draft.graph_draft import encoding_of, size_of
from riot_bus.draft.model import INSIDE, OUTSIDE, DraftComponent, SystemDraft, TopicDraft, Used
from riot_bus.vocabulary.redaction import escape_control_chars as comment
from riot_bus.vocabulary.text_table import table_lines
from riot_bus.vocabulary.toml_text import toml_string, toml_value

_MARK = "FILL IN"


def draft_toml(found: SystemDraft, *, origin: str, name: str, nominal: str | None = None) -> str:
    """Return the text of a system file."""
    types = _node_types(found) if found.adapter else _types(found)
    tested = [part.name for part in found.parts if _is_tested(part, found.unit)]
    log = '\n# log = "nominal.mcap"   # a recording of its inputs; without it, the system is run to make one'
    units = [f"[unit.{each}]{log if found.adapter else ''}" for each in tested]
    if not tested and not found.adapter:
        units = [f"# [unit.NAME]   # {_MARK}: the component that is to be tested"]
    parts = [_component(part, found) for part in found.parts]
    blocks = [_head(found, origin, name, nominal), types, *parts, _external(found), *units]
    return "\n\n".join(filter(None, blocks)) + "\n"


def left_to_fill_in(found: SystemDraft) -> list[str]:
    """Return what the file of a plain Zenoh system marks with FILL IN, in a line each, with its place."""
    lines = [f"types: {topic}: {_type_unknown(known)}" for topic, known in _unclear(found)]
    for part in found.parts:
        lines += [f"components.{part.name}: {each}" for each in part.command.missing]
        if part.silent:
            lines.append(f"components.{part.name}: what it reads and writes")
    lines += [f"external: who publishes {topic}" for topic in found.unwritten]
    if not any(_is_tested(part, found.unit) for part in found.parts):
        lines.append("unit: the component that is to be tested")
    return lines


def draft_json(found: SystemDraft) -> dict[str, Any]:
    """Return the draft as JSON's kinds of values."""
    common = {"external": dict(found.external), "unit": found.unit}
    parts = [_part_json(part) if not found.adapter else _node_json(part) for part in found.parts]
    if found.adapter:
        return {"components": parts, **common, "unknown_types": list(found.unknown_types)}
    topics = {
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
    }
    return {
        "components": parts,
        "topics": topics,
        **common,
        "unknown_publisher": list(found.unwritten),
        "unknown_receiver": list(found.unread),
        "skipped": found.skipped,
        "listener": found.listener,
        "units": [part.name for part in found.parts if _is_tested(part, found.unit)],
        "fill_in": left_to_fill_in(found),
    }


def _part_json(part: DraftComponent) -> dict[str, Any]:
    return {
        "name": part.name,
        "segment": part.segment,
        "command": list(part.command.command),
        "cwd": part.command.cwd,
        "env": dict(part.command.env),
        "pid": part.command.pid or None,
        "inputs": [each.topic for each in part.inputs],
        "outputs": [each.topic for each in part.outputs],
        "services": list(part.services),
        "external": bool(part.external),
        "why_external": part.external,
    }


def _node_json(part: DraftComponent) -> dict[str, Any]:
    runs = part.command

    def topics(used: Iterable[Used]) -> list[dict[str, str]]:
        return [{"topic": each.topic, "type_name": each.type_name, "qos": each.qos} for each in used]

    return {
        "name": part.name,
        "nodes": list(part.nodes),
        "zid": part.zids[0],
        "inputs": topics(part.inputs),
        "outputs": topics(part.outputs),
        "services": list(part.services),
        "actions": list(part.actions),
        "started": {"pid": runs.pid, "command": list(runs.command), "cwd": runs.cwd} if runs.pid else None,
        "only": runs.only,
        "dds": part.dds,
        "segment": part.segment,
        "external": bool(part.external),
        "why_external": part.external,
    }


def draft_lines(found: Mapping[str, Any]) -> list[str]:
    """Return as text what `draft_json` found, with the `file` written and whether components were `started`."""
    lines = _nodes_lines(found) if "unknown_types" in found else _plain_lines(found)
    return [comment(line) for line in lines]


def _nodes_lines(found: Mapping[str, Any]) -> list[str]:
    rows = [(each["name"], each["segment"], _used_count(each)) for each in found["components"]]
    lines = [*table_lines(rows, left=range(3)), f"external topics: {', '.join(found['external']) or 'none found'}"]
    if found["unknown_types"]:
        lines.append(f"types without a definition here: {', '.join(found['unknown_types'])}")
    if found["skipped"]:
        lines.append(f"{found['skipped']} announcements were too many to look at")
    return [*lines, written_line(found["file"])]


def written_line(file: str) -> str:
    """Return the line that says which file was written, and what to do with it."""
    return f"written: {file}; next, fill in what it marks with {_MARK}, above all the commands"


def _used_count(part: Mapping[str, Any]) -> str:
    return f"{len(part['inputs'])} in, {len(part['outputs'])} out"


def _plain_lines(found: Mapping[str, Any]) -> list[str]:
    parts = found["components"]
    rows = [(each["name"], each["segment"], f"{_used_count(each)}  {shlex.join(each['command'])}") for each in parts]
    lines = [*table_lines(rows, left=range(3)), f"external topics: {', '.join(found['external']) or 'none known'}"]
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
    lines += [f"{_MARK} {each}" for each in found["fill_in"]]
    silent = any(not (part["inputs"] or part["outputs"]) for part in parts)
    if not found["started"] and silent and any(part["pid"] for part in parts):
        lines.append("--start starts each component once, on a segment of its own, and sees what it reads and writes")
    elif not found["fill_in"]:
        choose = f" --unit {found['units'][0]}" if len(found["units"]) > 1 else ""
        lines.append(f"nothing is left to fill in; next: riot test{choose}")
    return [*lines, f"written: {found['file']}"]


def _is_tested(part: DraftComponent, unit: str | None) -> bool:
    """Return whether a component gets a table as a unit: the chosen one, else all that read something inside."""
    return part.name == unit if unit is not None else bool(part.inputs) and not part.external


def _head(found: SystemDraft, origin: str, name: str, nominal: str | None) -> str:
    """Return the first comments of a file, and `[system]`."""
    segments = list(dict.fromkeys(part.segment for part in found.parts))
    note = "All keys: docs/riot-toml.md."
    lines = [
        f"# Written by `riot init`: {comment(origin)}.",
        f"# What a network cannot tell is marked with {_MARK}. {note}" if found.adapter else f"# {note}",
        "",
        "[system]",
        f"name = {toml_string(name)}",
        f"segments = {toml_value([OUTSIDE, INSIDE] if set(segments) <= {OUTSIDE, INSIDE} else segments)}",
    ]
    if nominal is not None:
        lines.append(f"nominal = {toml_string(nominal)}")
    if found.adapter:
        what = "the code under test; without it, stored trials outlive its changes"
        lines += [f'# sources = ["src/**/*.py"]   # {_MARK}: {what}', f'adapters = ["{found.adapter}"]']
    if found.unknown_types:
        lines.append(f"# {_MARK}: no definition of these types was found, so their fields are unknown:")
        lines += [f"#   {comment(each)}" for each in found.unknown_types]
        lines.append('# messages = ["my_msgs/msg/Name.msg"]')
    untyped = (encoding for topic in found.topics.values() if not topic.type_name for encoding in topic.encodings)
    if named := sorted({each for each in untyped if "protobuf" in each}):
        lines.append(f"# {_MARK}: descriptor sets that define what is published as {comment(', '.join(named))}:")
        lines.append('# messages = ["NAME.desc"]')
    if found.skipped:
        lines.append(f"# {found.skipped} more keys were too many to look at.")
    return "\n".join(lines)


def _node_types(found: SystemDraft) -> str:
    """Return the table of types behind zenoh-bridge-ros2dds, whose keys do not name them; empty for other bridges."""
    types = {used.topic: used.type_name for part in found.parts for used in (*part.inputs, *part.outputs)}
    if found.adapter != "ros2dds" or not types:
        return ""
    known = (item for item in sorted(types.items()) if item[1] not in found.unknown_types)
    return "\n".join(["[system.types]", *(f"{toml_string(topic)} = {toml_string(name)}" for topic, name in known)])


def _types(found: SystemDraft) -> str:
    """Return the table of types that must be declared or are unknown; empty if there are none."""
    rows = []
    for topic, known in found.topics.items():
        if known.declare:
            encoding = encoding_of(known)
            why = f"their encoding is {encoding}" if encoding else "they have no encoding"
            why = comment(f"all {known.read} payloads read so, but {why}")
            rows.append(f"{toml_string(topic)} = {toml_string(known.type_name)}   # {why}")
    for topic, known in _unclear(found):
        guess = known.fits[0] if known.fits else "raw"
        rows.append(f"# {toml_string(topic)} = {toml_string(guess)}   # {_MARK}: {comment(_type_unknown(known))}")
    return "\n".join(["[system.types]", *rows]) if rows else ""


def _unclear(found: SystemDraft) -> Iterator[tuple[str, TopicDraft]]:
    """Yield the topics of unknown type that had nonempty payloads."""
    for topic, known in found.topics.items():
        if not known.type_name and known.sizes[1]:
            yield topic, known


def _type_unknown(topic: TopicDraft) -> str:
    if topic.fits:
        return f"{' or '.join(topic.fits)}? all {topic.read} payloads, of {size_of(topic)}, can be read so"
    what = ", ".join(filter(None, (encoding_of(topic), size_of(topic))))
    return f"{what}: no codec reads them; a packed structure is raw(float32 x, uint8 mode)"


def _component(part: DraftComponent, found: SystemDraft) -> str:
    runs = part.command
    lines = [f"[components.{part.name}]", *(f"# {comment(note)}" for note in part.notes)]
    lines += [f"# {_MARK}: {comment(each)}." for each in runs.missing]
    origin = f"   # as process {runs.pid} was started" if runs.pid and not part.notes else ""
    lines.append(f"command = {toml_value(runs.command)}{origin}")
    if runs.cwd != ".":
        lines.append(f"cwd = {toml_string(runs.cwd)}")
    if runs.only:
        lines.append(f"only = {toml_string(runs.only)}")
    if part.dds:
        lines.append("dds = true")
    if runs.env:
        lines.append(f"env = {toml_value(runs.env)}")
    lines.append(f"segment = {toml_string(part.segment)}")
    if part.peer:
        lines.append("# A Zenoh peer: without multicast scouting, else it also finds what runs beside its trials.")
    if part.external:
        inside = f"; put it {INSIDE} if that is wrong" if part.segment == OUTSIDE else ""
        lines.append(f"external = true   # {comment(part.external)}{inside}")
    if part.silent and not found.adapter:
        lines.append(f"# {_MARK}: what it reads and writes, as inputs and outputs; nothing tells{_open(found)}.")
    for key, used in (("inputs", part.inputs), ("outputs", part.outputs)):
        if used:
            rows = _rows((each.topic, ", ".join(filter(None, (each.type_name, each.qos)))) for each in used)
            lines += [f"{key} = [", *rows, "]"]
    for what, names in (("Services", part.services), ("Actions", part.actions)):
        if names:
            lines.append(f"# {what}, which are not tested: {comment(', '.join(names))}.")
    return "\n".join(lines)


def _open(found: SystemDraft) -> str:
    topics = list(dict.fromkeys([*found.unwritten, *found.unread]))
    if not topics:
        return ""
    named, more = topics[:12], len(topics) - 12  # at about 20 letters each, a line of 240
    rest = f" and {more} more" if more > 0 else ""
    return f". The components of these topics are unknown: {comment(', '.join(named))}{rest}"


def _rows(items: Iterable[tuple[str, str]]) -> list[str]:
    """Return the lines of a list of texts in TOML, each with its comment in one column."""
    rows = [(f"    {toml_string(text)},", remark) for text, remark in items]
    width = max((len(row) for row, _ in rows), default=0)
    return [f"{row:{width}}   # {comment(remark)}" if remark else row for row, remark in rows]


def _external(found: SystemDraft) -> str:
    """Return the table of what is external: by keys, since runs of the whole system change messages key by key."""
    keys = {key: why for topic, why in found.external.items() for key in found.groups.get(topic, [topic])}
    mark, topic = (f"{_MARK}: ", "/topic") if found.adapter else ("", "key")
    if keys:
        what = f". {_MARK}: " if found.adapter else "; "
        lines = [
            f"# What the outside world controls{what}take out what it does not.",
            "topics = [",
            *_rows(keys.items()),
        ]
        lines.append("]")
    else:
        lines = [
            f"# {mark}Nothing is known to come from outside: name who plays the outside world with --external NAME,",
            "# or write here what the outside controls. Without topics the chain ends with the rule.",
            "topics = []",
        ]
    unwritten = [
        f"# {toml_string(topic)} was published by an unknown component: {_MARK} which one it is."
        for topic in found.unwritten
    ]
    example = [f'# "{topic}:field.*" = [-1.0, 1.0]   # {mark}values that the outside can take']
    return "\n".join(["[external]", *lines, *unwritten, "", "# [external.ranges]", *example])
