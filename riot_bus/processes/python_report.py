"""Reports of Python components in a trial (see `python_hook/sitecustomize.py`), as read by riot."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from riot_bus.monitors.signature import frames_in

HOOK = Path(__file__).with_name("python_hook")
_OURS = (str(HOOK), str(HOOK.with_name("fork_server.py")))

_LIBRARIES = re.compile(r"/lib(?:64)?/python\d|[/\\](?:site|dist)-packages[/\\]|^<frozen")
_LARGEST = 1 << 20
_SAFE_S = 0.5
"""Seconds to wait for the answer of a main thread, which comes if it returns to Python code."""
_WHOLE = re.compile(r"( in (<module>|_run_module_as_main)|\nall threads)\n$")
"""End of a complete report: the main thread comes last, or a line that the hook adds."""


@dataclass(frozen=True, slots=True)
class MainEnd:
    """The end of a main thread: by which call, such as `sys.exit(3)`, and in which function; empty if it returned."""

    call: str = ""
    function: str = ""


@dataclass(frozen=True, slots=True)
class ThreadStack:
    """Stack of a thread.

    Attributes:
        functions: Functions of the component's own code, the innermost first; those of libraries are left out.
    """

    functions: tuple[str, ...]
    text: str


class PythonReport:
    """The files of one trial that the hook writes."""

    def __init__(self, directory: Path) -> None:
        self._events = directory / "python.events"
        self._stacks = directory / "python.stacks"
        self._imports = directory / "python.imports"
        self._known: tuple[int, list[dict[str, object]]] = 0, []

    def environment(self, given: Mapping[str, str], *, imports: bool = False) -> dict[str, str]:
        """Return the variables that make the hook work, for a component with these."""
        more = {"RIOT_TRIAL_IMPORTS": str(self._imports)} if imports else {}
        return {
            "PYTHONPATH": os.pathsep.join([str(HOOK), *filter(None, [given.get("PYTHONPATH", "")])]),
            "RIOT_TRIAL_EVENTS": str(self._events),
            "RIOT_TRIAL_STACKS": str(self._stacks),
            **more,
        }

    def imports(self, pid: int) -> tuple[str, ...]:
        """Return the modules that a process has imported, in their order; none if it has no hook."""
        try:
            with self._imports.open(encoding="utf-8", errors="replace") as stream:
                lines = stream.read(_LARGEST).splitlines()
        except OSError:
            return ()
        return tuple(dict.fromkeys(line.partition(" ")[2] for line in lines if line.startswith(f"{pid} ")))

    def main_end(self, pids: Iterable[int]) -> MainEnd | None:
        """Return how a main thread of these processes has ended; None if none has, as far as Python knows."""
        events = self._read()
        for pid in pids:
            last = MainEnd()
            for event in events:
                if event.get("pid") != pid:
                    continue
                if event.get("event") == "exit":
                    last = _exit(event)
                elif event.get("event") == "main ended":
                    return last
        return None

    def goes_on(self, pid: int) -> bool:
        """Return whether the main thread of a process is known not to have ended; False without the hook."""
        told = {event.get("event") for event in self._read() if event.get("pid") == pid}
        return "ready" in told and not told & {"main ended", "exit"}

    def exit_call(self, pids: Iterable[int]) -> MainEnd | None:
        """Return the last call that was to end one of these processes; None if there was none."""
        wanted = set(pids)
        calls = [event for event in self._read() if event.get("event") == "exit" and event.get("pid") in wanted]
        return _exit(calls[-1]) if calls else None

    def stacks(self, pids: Iterable[int]) -> list[ThreadStack]:
        """Request the stacks of Python processes; nothing for processes without the hook."""
        ready = {event["pid"]: event for event in self._read() if event.get("event") == "ready"}
        found = []
        for pid in pids:
            if pid in ready:
                number, safe = int(str(ready[pid]["signal"])), int(str(ready[pid].get("safe", 0)))
                text = self._ask(pid, safe, _SAFE_S) if safe and _another_runs(pid) else ""
                found += parse_stacks(text or self._ask(pid, number, 2 * _SAFE_S))
        return found

    def _ask(self, pid: int, number: int, seconds: float) -> str:
        path = Path(f"{self._stacks}.{pid}")
        before = path.stat().st_size if path.exists() else 0
        with suppress(ProcessLookupError, PermissionError):
            os.kill(pid, number)
        deadline, text = time.monotonic() + seconds, ""
        still = 0
        # On a loaded machine, the text comes in pieces.
        while time.monotonic() < deadline and still < (1 if _WHOLE.search(text) else 10):
            time.sleep(0.005)
            now = _text_of(path, begin=before)
            still = still + 1 if now and now == text else 0
            text = now
        return text

    def _read(self) -> list[dict[str, object]]:
        try:
            size = self._events.stat().st_size
            if size == self._known[0]:  # it only grows, and a trial looks often
                return self._known[1]
            with self._events.open("rb") as stream:
                data = stream.read(_LARGEST)
        except OSError:
            return []
        found = []
        for line in data.splitlines():
            with suppress(ValueError):
                event = json.loads(line)
                if isinstance(event, dict):
                    found.append(event)
        self._known = len(data), found
        return found


def _exit(event: Mapping[str, object]) -> MainEnd:
    return MainEnd(f"{event.get('call')}({event.get('status')})", str(event.get("function")))


def _another_runs(pid: int) -> bool:
    """Return whether a thread other than the main one runs; its frames cannot be read safely without Python's help.

    `faulthandler` does so, and has been seen to end a process whose thread was deep in a recursion.
    """
    with suppress(OSError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            if thread.name != str(pid):
                with suppress(OSError, IndexError):
                    if (thread / "stat").read_bytes().rpartition(b")")[2].split()[0] in b"RD":
                        return True
    return False


def _text_of(path: Path, *, begin: int) -> str:
    try:
        with path.open("rb") as stream:
            stream.seek(begin)
            return stream.read(_LARGEST).decode(errors="replace")
    except OSError:
        return ""


def parse_stacks(text: str) -> list[ThreadStack]:
    """Return the threads of what `faulthandler` has written; those that never ran the component's code are left out."""
    found = []
    for part in re.split(r"\n\s*\n", text):
        frames = (each for each in frames_in(part) if not each.file.startswith(_OURS))
        if functions := tuple(each.function for each in frames if not _LIBRARIES.search(each.file)):
            found.append(ThreadStack(functions, part.strip()))
    return found


def deepest_common(looks: Sequence[Sequence[ThreadStack]]) -> list[ThreadStack]:
    """Return the threads of several looks, each down to the innermost function in which it stood in all of them.

    Threads are identified by their place in Python's own list, newest first; if their number changes between looks, the
    last look is returned.
    """
    if len({len(look) for look in looks}) != 1:
        return list(looks[-1])
    found = []
    for stacks in zip(*looks, strict=True):
        common = []
        for functions in zip(*(reversed(stack.functions) for stack in stacks), strict=False):
            if len(set(functions)) > 1:
                break
            common.append(functions[0])
        found.append(ThreadStack(tuple(reversed(common)) or stacks[-1].functions, stacks[-1].text))
    return found
