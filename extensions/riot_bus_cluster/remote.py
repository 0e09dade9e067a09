"""The part of riot on a worker of Dask: one function from bytes to bytes, which keeps a `pool.worker` process.

That process is the same as on riot's own machine. It ends with the worker, when its trial is no longer awaited
(Ctrl-C, a riot that was killed, a scheduler that is gone), and when it has not been used for a minute.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Pipe
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgpack  # type: ignore[import-untyped]

from riot_bus.pool.local import how_ended, start_worker
from riot_bus.trial.setup import TrialPlace
from riot_bus.trial.system_trial import EXTERNAL_LOG
from riot_bus_cluster.facts import differences

if TYPE_CHECKING:
    from distributed import Semaphore

MOST_FILES = 256 << 20
"""Most bytes of files that one trial returns: enough for most nominal logs; evidence is limited to a tenth of it."""
TRIAL = Path("trial")
"""Folder of a trial, below the working folder of the process that executes it."""
LOOK_S = 0.5
FACTS_WITHIN_S = 120.0
_UNUSED_S = 60.0
"""How long an unused process is kept; it is unused when riot was killed."""


class _Kept:
    """A `pool.worker` process, and the folder in which its trials have theirs."""

    def __init__(self, system: Path, slot: int, parent: str | None) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="riot-", dir=parent))
        self.link, theirs = Pipe()
        with theirs:
            self.process = start_worker(system, slot, theirs, cwd=self.folder)

    def end(self) -> str:
        self.link.close()
        how = how_ended(self.process)
        shutil.rmtree(self.folder, ignore_errors=True)
        return how


_kept: dict[str, _Kept] = {}
_semaphores: dict[str, Semaphore] = {}
_timers: dict[str, threading.Timer] = {}


def serve(data: bytes) -> bytes:
    """Do what riot asks, on a worker with one thread.

    Args:
        data: A table in MessagePack. `do` is `begin` (compare versions and code, and start a process), `run` (execute a
            case) or `end`; `name` is that of the process.

    Returns:
        A table in MessagePack. After `begin`: `refused` (why, if so) and `host`. After `run`: `answer` and `files`, or
        `died` (how the process has ended), or neither if there is no such process or the trial is no longer awaited.
        `error`: a traceback.
    """
    asked = msgpack.unpackb(data)
    name = str(asked["name"])
    if name in _timers:
        _timers.pop(name).cancel()
    try:
        found: dict[str, Any] = {"begin": _begin, "run": _run, "end": _end}[asked["do"]](asked, name)
    except Exception:  # the caller has to know of any error
        found = {"error": traceback.format_exc()}
    if name in _kept:
        _timers[name] = threading.Timer(_UNUSED_S, _end, [{}, name])
        _timers[name].daemon = True
        _timers[name].start()
    packed: bytes = msgpack.packb(found)
    return packed


def _begin(asked: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Compare versions and code with those of riot; start a process if they agree and a slot is given."""
    from distributed import get_worker

    system = Path(os.environ.get("RIOT_SYSTEM") or asked["system"])
    command = [sys.executable, "-P", "-m", "riot_bus_cluster.facts", str(system)]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=FACTS_WITHIN_S, cwd="/", check=False)
    if shown.returncode:
        return {"host": socket.gethostname(), "refused": shown.stderr.strip()[-2000:] or "riot_bus does not start"}
    refused = differences(json.loads(shown.stdout.splitlines()[-1]), asked["facts"])
    if not refused and asked["slot"] is not None:
        _kept[name] = _Kept(system, int(asked["slot"]), get_worker().local_directory)
    return {"host": socket.gethostname(), "refused": refused, "system": str(system)}


def _end(_: Mapping[str, Any], name: str) -> dict[str, Any]:
    if kept := _kept.pop(name, None):
        kept.end()
    return {}


def _run(asked: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Have a case executed; give up when its outcome is no longer awaited."""
    waited_for = _waited_for()
    if name not in _kept:
        return {}
    kept = _kept[name]
    folder = kept.folder / TRIAL
    folder.mkdir(exist_ok=True)
    try:
        with _held(asked["needs"], waited_for) as taken:
            try:
                if waited_for():
                    kept.link.send_bytes(asked["request"])
                while waited_for():
                    if kept.link.poll(LOOK_S):
                        return {"answer": kept.link.recv_bytes(), **_files(folder)}
                _end({}, name)
                return {}
            except (EOFError, OSError):
                for lease in set(taken):  # a component may live on for a moment: its leases expire instead
                    _semaphores.pop(lease).refresh_leases = False
                return {"died": _kept.pop(name).end()}
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _waited_for() -> Callable[[], bool]:
    """Return a function that tells whether the task of this thread is still awaited."""
    from distributed import Status, get_worker

    alive = (Status.running, Status.paused, Status.closing_gracefully)
    worker = get_worker()
    key = worker.get_current_task()

    def waited_for() -> bool:
        task = worker.state.tasks.get(key)
        return task is not None and task.state == "executing" and worker.status in alive

    return waited_for


@contextmanager
def _held(needs: Mapping[str, Sequence[int]], waited_for: Callable[[], bool]) -> Iterator[list[str]]:
    """Hold the scarce resources that a trial needs, across all workers, as `trial.scarce` does on one machine.

    A worker that dies holds them until its leases expire: nothing of its trial runs by then.

    Args:
        needs: Number that the trial needs, and number that there are in all, by name.
        waited_for: Function that tells whether the trial is still awaited.

    Yields:
        The names of the semaphores held; one that is removed from the list is not given back.
    """
    from distributed import Semaphore

    held: list[str] = []

    def take(name: str, total: int) -> None:
        if name not in _semaphores:
            _semaphores[name] = Semaphore(total, name)
        while waited_for():
            if _semaphores[name].acquire(timeout=2 * LOOK_S):
                held.append(name)
                return

    def give(name: str) -> None:
        held.remove(name)
        if name in _semaphores:
            _semaphores[name].release()

    try:
        for name, (count, total) in sorted(needs.items()):
            queue = f"{name} queue"  # one trial at a time takes all its pieces, so no two wait for each other
            take(queue, 1)
            for _ in range(count):
                take(name, total)
            if queue in held:
                give(queue)
        yield held
    finally:
        while held:
            give(held[-1])


def _files(folder: Path) -> dict[str, Any]:
    """Return the wanted files that a trial has left, up to a limit."""
    whole = (folder / EXTERNAL_LOG).exists()
    found = folder.rglob("*") if whole else [folder / TrialPlace.LEFT, *(folder / TrialPlace.LEFT).rglob("*")]
    paths = sorted(path for path in found if path.is_file() and not path.is_symlink())
    size = sum(path.stat().st_size for path in paths)
    if size > MOST_FILES:
        return {"files": {}, "left_out": size}
    return {"files": {str(path.relative_to(folder)): path.read_bytes() for path in paths}, "left_out": 0}
