"""A process that executes trials, one at a time: `python -m riot_bus.pool.worker RIOT_TOML SLOT`, from `local.Pool`.

It receives requests and sends answers over a socket on file descriptor 0. When the socket closes, even because riot was
killed by `kill -9`, the trial, its components and the worker end as well.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import time
import traceback
from collections.abc import Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from functools import cached_property
from multiprocessing.connection import Connection
from pathlib import Path

from riot_bus.control.heap import calm_collector
from riot_bus.pool.wire import Trial, TrialAnswer, TrialRequest, pack_answer, pack_failure
from riot_bus.processes.launcher import Launcher
from riot_bus.processes.supervisor import IGNORED
from riot_bus.trial.context import Context, open_system
from riot_bus.trial.hangs import KnownHangs
from riot_bus.trial.network import KeptNetwork
from riot_bus.trial.running_system import end_kept
from riot_bus.trial.setup import TrialPlace
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.session import prepare_runtime


class TrialWorker:
    """Executes requests."""

    def __init__(self, system: Path, launcher: Launcher) -> None:
        self._system, self._launcher = system, launcher
        self._known: dict[bytes, tuple[Trial, tuple[Message, ...]]] = {}
        self._imports: dict[str, Sequence[str]] = {}
        self._kept: list[AbstractContextManager[object]] = []
        self._network = KeptNetwork()

    @cached_property
    def _context(self) -> Context:
        context = open_system(self._system)
        # a thread receives from each component's two links; some, from other routers and riot's own sessions
        prepare_runtime(2 * len(context.file.components) + 8)
        return context

    def _place(self, directory: Path) -> TrialPlace:
        return TrialPlace(self._context, self._launcher, directory, self._imports, self._kept, self._network)

    def close(self) -> None:
        """Close what is kept for a next trial."""
        self._network.close()

    def _cpu(self) -> float:
        """Return the processor time of this process and of components that have ended, in seconds."""
        return time.process_time() + self._launcher.cpu()

    def answer(self, data: bytes) -> bytes:
        """Execute a request and return the answer; an error that it raises becomes an answer, too."""
        try:
            request = TrialRequest.read(data, self._known)
            self._imports.update(request.imports)
            before, hangs = set(self._imports), self._context.hangs
            for name, told in request.hangs.items():
                hangs[name].know(told)
            place = self._place(request.directory)
            if not isinstance(request.trial, SystemTrial):  # it ends them itself if needed
                end_kept(place)
            began, used = time.monotonic(), self._cpu()
            outcome = request.trial.run(request.case, place)
            busy = (self._cpu() - used) / (time.monotonic() - began)
            outcome = replace(outcome, statistics={**outcome.statistics, "busy": round(busy, 3)})
            learnt = {name: modules for name, modules in self._imports.items() if name not in before}
            known = {name: each.tell() for name, each in hangs.items()}
            found = {name: each for name, each in known.items() if each != request.hangs.get(name, KnownHangs())}
            return pack_answer(TrialAnswer(outcome, learnt, found))
        except Exception as error:  # the requesting process has to know of any error
            return pack_failure(error, traceback.format_exc())


def _receive(link: Connection, requests: queue.SimpleQueue[bytes | None], launcher: Launcher) -> None:
    """Receive requests until the socket closes; then kill what still runs, and the worker if it does not exit."""
    with suppress(EOFError, OSError):
        while True:
            requests.put(link.recv_bytes())
    requests.put(None)
    launcher.close()
    threading.Event().wait(15.0)  # for a trial with dead components to remove its segments, even on a loaded machine
    os._exit(1)


def main() -> None:
    """Serve the socket on file descriptor 0 until it closes."""
    for number in IGNORED:
        signal.signal(number, signal.SIG_IGN)
    link = Connection(os.dup(0))
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    os.dup2(2, 1)  # the output of monitors is not part of the result
    requests: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
    launcher = Launcher(int(sys.argv[2]))
    threading.Thread(target=_receive, args=(link, requests, launcher), daemon=True).start()
    worker, began = TrialWorker(Path(sys.argv[1]), launcher), False
    with suppress(BrokenPipeError, ConnectionResetError):
        while (data := requests.get()) is not None:
            link.send_bytes(worker.answer(data))
            if not began:
                calm_collector()  # the first trial has loaded all
            began = True
    worker.close()
    launcher.close()
    os._exit(0)  # Zenoh's threads have nothing left to do


if __name__ == "__main__":
    main()
