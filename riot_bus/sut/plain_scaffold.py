"""A draft of a plain Zenoh system as riot.toml, as a list of what is left to fill in, and as JSON."""

from __future__ import annotations

import re
import shlex
from typing import TYPE_CHECKING, Any

from riot_bus.sut.plain_topics import size_of
from riot_bus.sut.scaffold import comment, external_topics, is_tested, topic_list
from riot_bus.sut.system_draft import INSIDE, OUTSIDE
from riot_bus.vocabulary.toml_text import toml_string, toml_value

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from riot_bus.sut.plain_draft import PlainDraft
    from riot_bus.sut.system_draft import DraftComponent
    from riot_bus.sut.topic_look import TopicDraft

__all__ = ["draft_json", "draft_lines", "draft_toml", "left_to_fill_in"]

_MARK = "FILL IN"
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_MOST_NAMED = 12  # topics in one comment: at about 20 letters each, a line of 240


def draft_toml(found: PlainDraft, *, origin: str, name: str, nominal: str | None = None) -> str:
    """Return the text of a system file.

    Args:
        found: The system.
        origin: Where and how it was seen, for the first comment.
        name: What the system is called.
        nominal: Path of its nominal log.
    """
    parts = found.system.parts
    blocks = [
        _head(found, origin, name, nominal),
        *filter(None, [_types(found)]),
        *(_component(part, found) for part in parts),
        _external(found),
    ]
    blocks += [f"[unit.{part.name}]" for part in parts if is_tested(part, found.system.unit)]
    if not any(is_tested(part, found.system.unit) for part in parts):
        blocks.append(f"# [unit.NAME]   # {_MARK}: the component that is to be tested")
    return "\n\n".join(blocks) + "\n"


def left_to_fill_in(found: PlainDraft) -> list[str]:
    """Return what the file marks with FILL IN, in a line each, with its place."""
    lines = [f"types: {topic}: {_type_unknown(known)}" for topic, known in _unclear(found)]
    for part in found.system.parts:
        lines += [f"components.{part.name}: {each}" for each in found.commands[part.name].missing]
        if part.name in found.silent:
            lines.append(f"components.{part.name}: what it reads and writes")
    lines += [f"external: who publishes {topic}" for topic in found.unwritten]
    if not any(is_tested(part, found.system.unit) for part in found.system.parts):
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
        "units": [part.name for part in found.system.parts if is_tested(part, found.system.unit)],
        "fill_in": left_to_fill_in(found),
    }


def draft_lines(found: Mapping[str, Any]) -> list[str]:
    """Return a draft as text: its components, what is external, what is left to fill in, and what to do next.

    Args:
        found: As `draft_json` returns it, and whether components were `started`.
    """
    parts = found["components"]
    widths = [max(len(part[key]) for part in parts) for key in ("name", "segment")]
    lines = [
        f"{part['name']:{widths[0]}}  {part['segment']:{widths[1]}}  {len(part['inputs'])} in, "
        f"{len(part['outputs'])} out  {shlex.join(part['command'])}"
        for part in parts
    ]
    lines.append(f"external topics: {', '.join(found['external']) or 'none known'}")
    lines += [f"{topic}: type unknown" for topic, each in found["topics"].items() if not each["type"]]
    if found["unknown_publisher"]:
        lines.append(f"published by nobody that is known: {', '.join(found['unknown_publisher'])}")
    if found["unknown_receiver"]:
        lines.append(f"read by somebody who is not known: {', '.join(found['unknown_receiver'])}")
    if found["skipped"]:
        lines.append(f"{found['skipped']} more keys were too many to look at")
    if any(topic.startswith("/") for topic in found["topics"]):
        lines.append("there are ROS 2 nodes: riot init --ros2 tells more of them")
    if found["listener"]:
        lines.append("somebody reads everything, such as a recorder, so that who else reads what does not show")
    lines += [f"FILL IN {each}" for each in found["fill_in"]]
    silent = any(not (part["inputs"] or part["outputs"]) for part in parts)
    if not found["started"] and silent and any(part["pid"] for part in parts):
        lines.append("--start starts each component once, on a segment of its own, and sees what it reads and writes")
    elif not found["fill_in"]:
        choose = f" --unit {found['units'][0]}" if len(found["units"]) > 1 else ""
        lines.append(f"nothing is left to fill in; next: riot test{choose}")
    return [comment(line) for line in lines]


def _head(found: PlainDraft, origin: str, name: str, nominal: str | None) -> str:
    segments = list(dict.fromkeys(found.segments.values()))
    if set(segments) <= {OUTSIDE, INSIDE}:
        segments = [OUTSIDE, INSIDE]
    lines = [
        f"# Written by `riot init`: {comment(origin)}.",
        "# All keys: docs/riot-toml.md.",
        "",
        "[system]",
        f"name = {toml_string(name)}",
        f"segments = {toml_value(segments)}",
    ]
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
        lines.append(f"env = {_table(runs.env)}")
    lines.append(f"segment = {toml_string(found.segments[part.name])}")
    if part.name in found.peers:
        lines.append("# A Zenoh peer: without multicast scouting, else it also finds what runs beside its trials.")
    if part.external:
        inside = f"; put it {INSIDE} if that is wrong" if found.segments[part.name] == OUTSIDE else ""
        lines.append(f"external = true   # {comment(part.external)}{inside}")
    lines += topic_list("inputs", part.inputs)
    lines += topic_list("outputs", part.outputs)
    if part.name in found.silent:
        lines.append(f"# {_MARK}: what it reads and writes, as inputs and outputs; nothing tells{_open(found)}.")
    if part.services:
        lines.append(f"# Services, which are not tested: {comment(', '.join(part.services))}.")
    return "\n".join(lines)


def _open(found: PlainDraft) -> str:
    topics = list(dict.fromkeys([*found.unwritten, *found.unread]))
    if not topics:
        return ""
    more = f" and {len(topics) - _MOST_NAMED} more" if len(topics) > _MOST_NAMED else ""
    return f". Whose these are is not known: {comment(', '.join(topics[:_MOST_NAMED]))}{more}"


def _table(env: Mapping[str, str]) -> str:
    pairs = (
        f"{name if _BARE.fullmatch(name) else toml_string(name)} = {toml_string(text)}" for name, text in env.items()
    )
    return f"{{ {', '.join(pairs)} }}"


def _external(found: PlainDraft) -> str:
    external = found.system.external
    # Runs of the whole system change messages key by key, so what is external is named by keys.
    keys = {key: why for topic, why in external.items() for key in found.groups.get(topic, [topic])}
    lines = ["[external]"]
    if keys:
        lines.append("# What the outside world controls; take out what it does not.")
        lines += external_topics(keys)
    else:
        lines.append("# Nothing is known to come from outside; without topics here the chain ends with the rule.")
        lines.append("topics = []")
    lines += [
        f"# {toml_string(topic)} was published, by nobody that is known: {_MARK} who it is."
        for topic in found.unwritten
    ]
    lines += ["", "# [external.ranges]", '# "key:field.*" = [-1.0, 1.0]   # values that the outside can take']
    return "\n".join(lines)
