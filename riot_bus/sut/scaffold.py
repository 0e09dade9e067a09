"""A sketch of a system as riot.toml, with comments on what is not known, and as JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from riot_bus.control.environment import environment
from riot_bus.sut.system_draft import INSIDE, OUTSIDE
from riot_bus.vocabulary.redaction import escape_control_chars as comment
from riot_bus.vocabulary.toml_text import toml_string, toml_value

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from riot_bus.sut.system_draft import DraftComponent, SystemDraft, Used

__all__ = ["comment", "external_topics", "is_tested", "sketch_json", "sketch_toml", "topic_list"]

PROGRAM = ("ros2", "run", "PACKAGE", "EXECUTABLE")
"""Placeholder for the command of a component, which a network does not reveal."""


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
    """Return the text of a system file.

    Args:
        found: The system.
        origin: Where and how it was seen, for the first comment.
    """
    blocks = [_head(found, origin), *(_component(part, bridged=found.bridged) for part in found.parts)]
    blocks.append(_external(found))
    blocks += [_unit(part) for part in found.parts if is_tested(part, found.unit)]
    return "\n\n".join(blocks) + "\n"


def is_tested(part: DraftComponent, unit: str | None) -> bool:
    """Return whether a component gets a table as a unit: the chosen one, else all that read something inside."""
    return part.name == unit if unit is not None else bool(part.inputs) and not part.external


def _head(found: SystemDraft, origin: str) -> str:
    lines = [
        f"# Written by `riot init`: {comment(origin)}.",
        "# What a network cannot tell is marked with FILL IN. All keys: docs/riot-toml.md.",
        "",
        "[system]",
        'name = "ros2"',
        f'segments = ["{OUTSIDE}", "{INSIDE}"]',
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


def _component(part: DraftComponent, *, bridged: bool) -> str:
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
        settings = environment(["{endpoint}"], "rmw_zenoh")
        inside = ", ".join(f"{name} = {toml_string(value)}" for name, value in settings.items())
        lines.append(f"env = {{ {inside} }}")
    lines.append(f'segment = "{_segment(part)}"')
    if part.external:
        lines.append(f"external = true   # {comment(part.external)}; put it {INSIDE} if that is wrong")
    lines += topic_list("inputs", part.inputs)
    lines += topic_list("outputs", part.outputs)
    for what, names in (("Services", part.services), ("Actions", part.actions)):
        if names:
            lines.append(f"# {what}, which are not tested: {comment(', '.join(names))}.")
    return "\n".join(lines)


def _remaps(part: DraftComponent) -> list[str]:
    if len(part.nodes) != 1:
        return []
    namespace, _, name = part.nodes[0].rpartition("/")
    words = ["--ros-args", "-r", f"__node:={name}"]
    return [*words, "-r", f"__ns:={namespace}"] if namespace else words


def topic_list(key: str, used: Iterable[Used]) -> list[str]:
    """Return the lines of a list of topics, with their types as comments; none if there are no topics."""
    rows = [(f"    {toml_string(each.topic)},", ", ".join(filter(None, (each.type_name, each.qos)))) for each in used]
    if not rows:
        return []
    width = max(len(row[0]) for row in rows)
    return [
        f"{key} = [",
        *(f"{row[0]:{width}}   # {comment(row[1])}" if row[1] else row[0] for row in rows),
        "]",
    ]


def _external(found: SystemDraft) -> str:
    lines = ["[external]"]
    if not found.external:
        lines.append("# FILL IN: no node was seen that only publishes; name those that play the outside world with")
        lines.append(
            "# --external NODE, or write here what the outside controls. Without it the chain ends with the rule."
        )
        lines.append("topics = []")
    else:
        lines.append("# What the outside world controls. FILL IN: take out what it does not.")
        lines += external_topics(found.external)
    lines += [
        "",
        "# [external.ranges]",
        '# "/topic:field.*" = [-1.0, 1.0]   # FILL IN: values that the outside can take',
    ]
    return "\n".join(lines)


def external_topics(external: Mapping[str, str]) -> list[str]:
    """Return the lines of the list of external topics, with why each is thought to be one as a comment."""
    rows = [(f"    {toml_string(topic)},", why) for topic, why in external.items()]
    width = max(len(row[0]) for row in rows)
    return ["topics = [", *(f"{row[0]:{width}}   # {comment(row[1])}" for row in rows), "]"]


def _unit(part: DraftComponent) -> str:
    return "\n".join(
        [
            f"[unit.{part.name}]",
            '# log = "nominal.mcap"   # a recording of its inputs; without it, the system is run to make one',
        ]
    )


def _segment(part: DraftComponent) -> str:
    return OUTSIDE if part.external else INSIDE
