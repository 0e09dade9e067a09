"""Facts about a running process: its program, its environment, and its files that name an endpoint to connect to."""

from __future__ import annotations

import os
import shutil
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.sut.command_draft import ProcessFacts, locators

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from riot_bus.graph.survey import Started

__all__ = ["facts_of"]

_MOST_BYTES = 1 << 18  # settings have some KiB; larger files in a command are data or programs
_MOST_WORDS = 100  # each may name a file that is read: at most 25 MiB together


def facts_of(started: Started, ports: Collection[int]) -> ProcessFacts:
    """Return facts about a process of this machine, without those that this user may not see.

    Args:
        started: The running process.
        ports: Ports that it may connect to.
    """
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
    words = [*started.command[1:_MOST_WORDS], *(each for name, each in environment.items() if name.startswith("ZENOH"))]
    for word in dict.fromkeys(words):
        path = Path(os.path.normpath(os.path.join(started.cwd, word.rpartition("=")[2])))
        with suppress(OSError, ValueError):  # a word that is no path, or a file that is no text
            if path.is_file() and path.stat().st_size <= _MOST_BYTES:
                yield path, path.read_text(encoding="utf-8")
