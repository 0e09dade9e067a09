"""Running processes of this machine as `riot init` sees them: their programs, environments and files, and ROS nodes.

Of the nodes behind a `riot bridge ros2`, it finds the launch that started them.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.draft.command_draft import ProcessFacts, locators
from riot_bus.draft.model import CommandDraft

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    import psutil

    from riot_bus.graph.survey import Started

_MOST_BYTES = 1 << 18  # settings have some KiB; larger files in a command are data or programs
_DOMAIN = "ROS_DOMAIN_ID"
_PYTHON = re.compile(r"(?:python|pypy)[0-9.]*t?")
_NODE = re.compile(r"(?:^|:)__(?:node|name):=(.+)")
_NAMESPACE = re.compile(r"(?:^|:)__ns:=(.+)")


def facts_of(started: Started, ports: Collection[int]) -> ProcessFacts:
    """Return facts about a process of this machine, without those that this user may not see."""
    import psutil

    environment: dict[str, str] = {}
    with suppress(psutil.Error, OSError):
        environment = psutil.Process(started.pid).environ()
    program = _program(started, environment)
    texts = {str(path): text for path, text in _texts(started, environment) if locators(text, ports)}
    return ProcessFacts(started.pid, started.command, started.cwd, program, environment, texts)


def _program(started: Started, environment: Mapping[str, str]) -> str:
    """Return the path of the executed program; riot's own path of its Python if the program is that Python."""
    first = started.command[0]
    path = os.path.join(started.cwd, first) if os.sep in first else shutil.which(first, path=environment.get("PATH"))
    if path is None:
        return ""
    path, python = os.path.normpath(path), sys.executable
    # Python environments differ by the folder of the symbolic link, not by its target.
    same = os.path.realpath(path) == os.path.realpath(python)
    return python if same and os.path.samefile(os.path.dirname(path), os.path.dirname(python)) else path


def _texts(started: Started, environment: Mapping[str, str]) -> Iterator[tuple[Path, str]]:
    """Yield the files of text that a command and Zenoh's variables name."""
    words = [*started.command[1:100], *(each for name, each in environment.items() if name.startswith("ZENOH"))]
    for word in dict.fromkeys(words):
        path = Path(os.path.normpath(os.path.join(started.cwd, word.rpartition("=")[2])))
        with suppress(OSError, ValueError):  # the word is not a path, or the file is not text
            if path.is_file() and path.stat().st_size <= _MOST_BYTES:
                yield path, path.read_text(encoding="utf-8")


def bridged_domain(bridge: Started) -> int | None:
    """Return the ROS domain that a process joins to a segment; None for other processes than `riot bridge ros2`."""
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


def nodes_of_domain(domain: int) -> dict[str, CommandDraft]:
    """Return what has started the nodes of a ROS domain that this user may see, by the node's name in its own command.

    That is the Python program that has started the process of the node, such as `ros2 launch`, else this process.
    The name is the full one where the command has `__node:=NAME`, otherwise that of the program or script.
    """
    import psutil

    named: dict[str, CommandDraft] = {}
    guessed: dict[str, CommandDraft] = {}
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


def _start(process: psutil.Process, domain: int, name: str) -> CommandDraft:
    parent = process.parent()
    if parent is not None and _domain(parent.environ()) == domain:
        words = parent.cmdline()
        if words and _PYTHON.fullmatch(os.path.basename(words[0])):
            return CommandDraft(tuple(words), parent.cwd(), pid=parent.pid, only=re.escape(name))
    return CommandDraft(tuple(process.cmdline()), process.cwd(), pid=process.pid)


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
