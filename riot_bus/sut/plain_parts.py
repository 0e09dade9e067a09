"""The components of a plain Zenoh system: which sessions belong together, and what to call them; pure."""

from __future__ import annotations

import re
from collections import defaultdict
from typing import TYPE_CHECKING

from riot_bus.sut.system_draft import free_name

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping, Sequence

    from riot_bus.graph.model import ConnectedComponent, Graph
    from riot_bus.sut.command_draft import CommandDraft

__all__ = ["component_names", "sessions_by_process"]

_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
_MODULE = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+")

Process = tuple["ConnectedComponent", ...]


def sessions_by_process(graph: Graph) -> list[Process]:
    """Return the sessions of each component: those of one process belong together, and routers are left out."""
    found: defaultdict[Hashable, list[ConnectedComponent]] = defaultdict(list)
    for each in graph.components:
        if each.mode != "router":
            found[each.pid or each.zid].append(each)
    ordered = sorted(found.values(), key=lambda each: (each[0].segment, each[0].label, each[0].pid or 0, each[0].zid))
    return [tuple(each) for each in ordered]


def component_names(processes: Sequence[Process], commands: Mapping[str, CommandDraft]) -> dict[str, str]:
    """Return the name in riot.toml of the component of each session.

    That is its usual name; if several have the same one, the first word that only its command has is added.

    Args:
        processes: The sessions of each component.
        commands: How components are started, by the ids of their sessions.
    """
    called = [_short(process[0].label) for process in processes]
    words = [_words(process, commands) for process in processes]
    taken: set[str] = set()
    found: dict[str, str] = {}
    for number, process in enumerate(processes):
        twins = [words[other] for other, name in enumerate(called) if name == called[number] and other != number]
        own = next((word for word in words[number] if twins and not any(word in twin for twin in twins)), "")
        name = free_name(f"{called[number]}_{own}" if own else called[number], taken)
        found |= {each.zid: name for each in process}
    return found


def _short(label: str) -> str:
    """Return a program's name without its language and its package."""
    base = label.removesuffix(".py")
    return base.rpartition(".")[2] if _MODULE.fullmatch(base) else base


def _words(process: Process, commands: Mapping[str, CommandDraft]) -> list[str]:
    known = next((commands[each.zid] for each in process if each.zid in commands), None)
    return [word for word in known.command[1:] if _WORD.fullmatch(word)] if known is not None else []
