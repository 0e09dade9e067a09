"""What several benchmarks do alike: time an action, start a process, name the machine, print a table."""

from __future__ import annotations

import os
import platform
import statistics
import subprocess
import time
from importlib.metadata import version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from contextlib import ExitStack


def rate(action: Callable[[], object], *, count: int, repeats: int) -> float:
    """Return how many of `count` things an action does in a second, by the median of its times."""
    times = []
    for _ in range(repeats):
        begun = time.perf_counter()
        action()
        times.append(time.perf_counter() - begun)
    return count / statistics.median(times)


def started(words: Sequence[str], stack: ExitStack) -> subprocess.Popen[str]:
    """Start a process with pipes for its input and output; the stack kills it."""
    process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    stack.enter_context(process)
    stack.callback(process.kill)
    return process


def machine() -> dict[str, object]:
    """Return what figures of routers depend on: cores, system, and versions of Python and Zenoh."""
    return {
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "zenoh": version("eclipse-zenoh"),
    }


def show(title: str, rows: Sequence[Mapping[str, object]]) -> None:
    """Print rows as a table in Markdown, with the columns of the first one."""
    print(f"\n## {title}\n")
    heads = list(rows[0])
    print("| " + " | ".join(heads) + " |")
    print("|" + "---|" * len(heads))
    for row in rows:
        print("| " + " | ".join(str(row.get(head, "")) for head in heads) + " |")
