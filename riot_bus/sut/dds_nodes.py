"""Processes of this machine that are the ROS nodes behind a `riot bridge ros2`, and the launch that started them."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.graph.survey import Started

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import psutil

__all__ = ["NodeStart", "bridged_domain", "nodes_of_domain"]

_DOMAIN = "ROS_DOMAIN_ID"
_PYTHON = re.compile(r"(?:python|pypy)[0-9.]*t?")
_NODE = re.compile(r"(?:^|:)__(?:node|name):=(.+)")
_NAMESPACE = re.compile(r"(?:^|:)__ns:=(.+)")


@dataclass(frozen=True, slots=True)
class NodeStart:
    """How a ROS node was started.

    Attributes:
        started: The Python program that has started the node, such as `ros2 launch`; otherwise the node's own process.
        only: Regular expression that selects the node among the processes of that program; empty for its own process.
    """

    started: Started
    only: str = ""


def bridged_domain(bridge: Started) -> int | None:
    """Return the ROS domain that a process joins to a segment; None if it is no `riot bridge ros2`."""
    import psutil

    words = bridge.command
    if not any(words[at : at + 2] == ("bridge", "ros2") for at in range(len(words))):
        return None
    for at, word in enumerate(words):
        name, equals, value = word.partition("=")
        if name in ("--domain", "-d"):
            told = value if equals else "".join(words[at + 1 : at + 2])
            return int(told) if told.isdecimal() else None
    with suppress(psutil.Error, OSError):
        return _domain(psutil.Process(bridge.pid).environ())
    return None


def nodes_of_domain(domain: int) -> dict[str, NodeStart]:
    """Return the processes of a ROS domain that this user may see, by the name of the node in their command.

    The name is the full one where the command has `__node:=NAME`, otherwise that of the program or script.
    """
    import psutil

    named: dict[str, NodeStart] = {}
    guessed: dict[str, NodeStart] = {}
    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):  # gone, or of another user
            if process.pid == os.getpid() or _domain(process.environ()) != domain:
                continue
            words = process.cmdline()
            name, program = _node_name(words), _program_name(words)
            if name or program:
                start = _start(process, domain, name.removeprefix("/") if name.count("/") == 1 else name or program)
                (named if name else guessed).setdefault(name or f"/{program}", start)
    return guessed | named


def _domain(environment: Mapping[str, str]) -> int:
    told = environment.get(_DOMAIN, "")
    return int(told) if told.isdecimal() else 0


def _start(process: psutil.Process, domain: int, name: str) -> NodeStart:
    parent = process.parent()
    if parent is not None and _domain(parent.environ()) == domain:
        words = parent.cmdline()
        if words and _PYTHON.fullmatch(os.path.basename(words[0])):
            return NodeStart(Started(parent.pid, tuple(words), parent.cwd()), re.escape(name))
    return NodeStart(Started(process.pid, tuple(process.cmdline()), process.cwd()))


def _node_name(words: Sequence[str]) -> str:
    """Return the full name of the node that a command names; empty if it names none."""
    nodes = [found[1] for found in map(_NODE.search, words) if found]
    spaces = [found[1] for found in map(_NAMESPACE.search, words) if found]
    return f"{spaces[-1].rstrip('/') if spaces else ''}/{nodes[-1]}" if nodes else ""


def _program_name(words: Sequence[str]) -> str:
    """Return the name of the program, or of the script that Python runs, without suffix; empty if there is none."""
    if words and _PYTHON.fullmatch(os.path.basename(words[0])):
        words = [word for word in words[1:] if not word.startswith("-")]
    return os.path.basename(words[0]).removesuffix(".py") if words else ""
