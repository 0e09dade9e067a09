"""The draft of a system of ROS 2 nodes, from what they announce; pure."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import replace
from typing import TYPE_CHECKING

from riot_bus.draft.model import CommandDraft, DraftComponent, SystemDraft, Used, draft_of, free_name
from riot_bus.vocabulary.errors import EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from riot_bus.types.capabilities import Announcement

_PROGRAM = ("ros2", "run", "PACKAGE", "EXECUTABLE")
"""Placeholder for the command of a component, which a network does not reveal."""
_PLUMBING = frozenset({"/rosout", "/parameter_events"})
_SETTING = re.compile(r"^[-\s]+(history|depth|reliability|durability):\s*(\w+)\s*$", re.MULTILINE)
_QOS = {
    ("reliability", "2"): "best effort",
    ("reliability", "best_effort"): "best effort",
    ("durability", "1"): "transient local",
    ("durability", "transient_local"): "transient local",
    ("history", "2"): "keep all",
    ("history", "keep_all"): "keep all",
}


def nodes_draft(
    announcements: Iterable[Announcement],
    *,
    offered: Mapping[str, Mapping[str, str]] | None = None,
    known: Callable[[str], bool] = lambda _: True,
    unit: str | None = None,
    external: Collection[str] = (),
    started: Mapping[str, CommandDraft] | None = None,
    behind: Mapping[str, Mapping[str, CommandDraft]] | None = None,
    where: str = "",
) -> SystemDraft:
    """Return the system that nodes and bridges announce.

    `offered` is the quality of service by key; `started` has the commands of processes by session id, and `behind`
    those of the ROS domain behind each `riot bridge ros2`, by session id and name of the node; `where` names the
    network in errors.

    Raises:
        EnvironmentFaultError: No nodes were seen.
        ConfigError: A node named by the user was not seen.
    """
    seen = [each for each in announcements if each.source != "advanced token" and not _hidden(each.node)]
    parts = _parts(seen, offered or {}, started or {}, behind or {})
    if not parts:
        raise EnvironmentFaultError(
            "no ROS 2 nodes were seen",
            where=where,
            hint="do they run with RMW_IMPLEMENTATION=rmw_zenoh_cpp (or behind zenoh-bridge-ros2dds) and connect to "
            "this router? Give it more time with --seconds, or name the router's endpoint with -e",
        )
    types = sorted({used.type_name for part in parts for used in (*part.inputs, *part.outputs)} - {""})
    return replace(
        draft_of(parts, unit=unit, external=external),
        adapter="ros2dds" if any(each.source == "bridge token" for each in seen) else "ros2",
        unknown_types=tuple(name for name in types if not known(name)),
    )


def _parts(
    seen: Sequence[Announcement],
    offered: Mapping[str, Mapping[str, str]],
    started: Mapping[str, CommandDraft],
    behind: Mapping[str, Mapping[str, CommandDraft]],
) -> list[DraftComponent]:
    by_process: defaultdict[tuple[str, str], list[Announcement]] = defaultdict(list)
    for each in seen:
        by_process[each.zid, each.node if each.zid in behind else ""].append(each)
    taken: set[str] = set()
    parts = []
    nodes_of = {process: tuple(sorted({each.node for each in said} - {""})) for process, said in by_process.items()}
    for process in sorted(by_process, key=lambda each: (nodes_of[each] or (f"/bridge_{each[0][:6]}",), each[0])):
        (zid, _), said, nodes = process, by_process[process], nodes_of[process]
        name = nodes[0] if nodes else f"/bridge_{zid[:6]}"
        if zid in behind:
            start = behind[zid].get(name) or behind[zid].get(f"/{name.rpartition('/')[2]}")
        else:
            start = started.get(zid)
        notes, command = _command(nodes, start, dds=zid in behind)
        data = [each for each in said if not each.action and each.topic not in _PLUMBING and not _hidden(each.topic)]
        parts.append(
            DraftComponent(
                name=free_name(name, taken),
                command=command,
                zids=(zid,),
                nodes=nodes,
                inputs=_used(data, "subscribes", {}),
                outputs=_used(data, "publishes", offered),
                services=tuple(sorted({f"{each.role} {each.topic}" for each in data if _asks(each)})),
                actions=tuple(sorted({each.action for each in said} - {""})),
                notes=notes,
                dds=zid in behind,
            )
        )
    return parts


def _command(nodes: Sequence[str], start: CommandDraft | None, *, dds: bool) -> tuple[tuple[str, ...], CommandDraft]:
    """Return comments on the command of a component, and the command."""
    notes = [f"One process with several nodes: {', '.join(nodes)}."] if len(nodes) > 1 else []
    if not nodes:
        notes.append("A bridge to DDS: FILL IN a command that starts it, and the ROS nodes behind it.")
    if start is not None:
        notes.append(f"As process {start.pid} was started. FILL IN what has to be different when riot starts it.")
    elif nodes:
        notes.append("FILL IN: how to start it (one process, not `ros2 launch` of the whole system).")
    command = start or CommandDraft((*_PROGRAM, *_remaps(nodes)))
    if nodes and not dds:
        from riot_bus.control.environment import environment

        command = replace(command, env=environment(["{endpoint}"], "rmw_zenoh"))
    return tuple(notes), command


def _remaps(nodes: Sequence[str]) -> tuple[str, ...]:
    if len(nodes) != 1:
        return ()
    namespace, _, name = nodes[0].rpartition("/")
    return ("--ros-args", "-r", f"__node:={name}", *(("-r", f"__ns:={namespace}") if namespace else ()))


def _hidden(name: str) -> bool:
    return any(part.startswith("_") for part in name.split("/"))


def _asks(each: Announcement) -> bool:
    parameters = each.topic.rpartition("/")[2].endswith(("_parameters", "_parameter_types", "get_type_description"))
    return each.role in ("serves", "calls") and not parameters


def _used(said: Sequence[Announcement], role: str, offered: Mapping[str, Mapping[str, str]]) -> tuple[Used, ...]:
    found = {
        each.topic: Used(each.topic, each.type_name, _qos(offered.get(each.key, {})))
        for each in said
        if each.role == role
    }
    return tuple(sorted(found.values()))


def _qos(details: Mapping[str, str]) -> str:
    settings = _SETTING.findall(details.get("offered_qos_profiles", ""))
    words = list(dict.fromkeys(_QOS[each] for each in settings if each in _QOS))
    depths = {value for name, value in settings if name == "depth"}
    if "transient local" in words and len(depths) == 1 and "keep all" not in words:
        words.append(f"depth {depths.pop()}")
    return ", ".join(words)
