"""The workers of a Dask cluster as those of a pool: each has one case at a time, so a death has one case to blame.

All decisions are made here: which case is executed when, how often it is tried, what its outcome is. The states of a
worker of the cluster (`WorkerState`):

    state      from       by
    asked      -, in use  it was found, or its process has ended: versions and code are compared, a process starts
    refused    asked      its answer, or its address and number of threads, which are looked at first
    ready      asked      its answer
    in use     ready      the pool, which gives it one case at a time
    gone       any        the scheduler no longer lists it: its case is executed again elsewhere
"""

from __future__ import annotations

import logging
import threading
import time
import uuid
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Pipe
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import msgpack  # type: ignore[import-untyped]

from riot_bus.pool.wire import TrialAnswer, read_answer
from riot_bus.trial.setup import needed
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.trial import Outcome, Verdict
from riot_bus_cluster.address import connect, is_open
from riot_bus_cluster.facts import facts_of
from riot_bus_cluster.remote import FACTS_WITHIN_S, LOOK_S, MOST_FILES, TRIAL, serve

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from distributed import Client, Future

    from riot_bus.pool.wire import Trial
    from riot_bus.system.system_file import SystemFile
    from riot_bus.trial.context import Context
    from riot_bus.vocabulary.trial import TestCase

_LOG = logging.getLogger(__name__)
_SCHEDULER_S = 10.0
"""Longest absence of the scheduler: a broken connection is restored within this time."""
_WORKERS_S = 60.0
"""Longest time without any worker, such as while killed ones are started again."""
_ENDS_WITHIN_S = 20.0  # not measured; a worker that does not answer ends its process after `remote._UNUSED_S`
_FETCH_S = 5.0
"""Longest transfer of a worker's answer once it is complete: a few bytes, maybe over a network.
If the worker dies just then, Dask waits for another one at the same address, for ever."""
_HINT = "all trials that have ended are kept: run the same command again to go on"


def ask(client: Client, address: str, table: Mapping[str, Any]) -> Future[Any]:
    """Have `remote.serve` do something on one worker; of our code, only that function's name is pickled."""
    data = msgpack.packb(table)
    return client.submit(
        serve, data, key=f"riot-{uuid.uuid4().hex}", workers=[address], allow_other_workers=False, pure=False
    )


def begin_of(context: Context, facts: Mapping[str, str], *, name: str, slot: int | None) -> dict[str, Any]:
    """Return the request to compare versions and code, and to start a process in a slot unless that is None."""
    return {"do": "begin", "name": name, "slot": slot, "facts": facts, "system": str(context.file.path.resolve())}


def why_not(address: str, threads: int) -> str:
    """Return why a worker is not even asked; empty if it is."""
    if is_open(address):
        return "it is beyond this machine, without TLS"
    return "" if threads == 1 else f"it has {threads} threads: start it with --nthreads 1, more of them with --nworkers"


@dataclass(eq=False, slots=True)
class WorkerState:
    """The state of a worker of the cluster.

    Attributes:
        name: Name of the process that it keeps for us.
        refused: Reason why it takes no trials; empty if it does.
    """

    slot: int
    name: str = ""
    begun: Future[Any] | None = None
    refused: str = ""
    ready: bool = False
    worker: _ClusterWorker | None = None


class ClusterWorkers:
    """Workers of a Dask cluster, as the source of a pool.

    Args:
        jobs: Maximum number of workers to use; 0 for all.
    """

    def __init__(self, executor: str, context: Context, jobs: int = 0) -> None:
        self._executor, self._context, self._limit = executor, context, jobs
        self._facts = facts_of(context)
        self._client = connect(executor)
        self._states: dict[str, WorkerState] = {}
        self._leaving: list[_ClusterWorker] = []
        self._wake: Callable[[], None] = lambda: None
        self._lock = threading.RLock()
        self._closing = threading.Event()
        self._failed: EnvironmentFaultError | None = None
        self._seen = self._had = time.monotonic()
        self._look()
        self._watch = threading.Thread(target=self._keep_looking, name="riot-cluster", daemon=True)

    @property
    def jobs(self) -> int:
        """Number of workers that take trials or have not been asked yet; at least one."""
        with self._lock:
            count = sum(not state.refused for state in self._states.values())
        return max(1, min(count, self._limit) if self._limit else count)

    def open(self, wake: Callable[[], None]) -> None:
        """Begin to watch which workers there are."""
        self._wake = wake
        self._watch.start()

    def start(self) -> _ClusterWorker | None:
        """Return a worker that is ready and not in use; None if there is none."""
        with self._lock:
            if self._failed:
                raise self._failed
            free = [each for each in self._states.items() if each[1].ready and not each[1].worker]
            taken = sum(state.worker is not None for state in self._states.values())
            if not free or (self._limit and taken >= self._limit):
                return None
            address, state = free[0]
            state.worker = _ClusterWorker(self, address, state.name)
            return state.worker

    def close(self) -> None:
        """End what runs on the workers, and leave the cluster."""
        self._closing.set()
        with self._lock, suppress(Exception):  # a scheduler that is gone has nothing left to end
            if not self._failed:
                for state in self._states.values():
                    if state.worker:
                        state.worker.cancel()
                kept = [(address, state.name) for address, state in self._states.items() if not state.refused]
                ends = [ask(self._client, address, {"do": "end", "name": name}) for address, name in kept]
                deadline = time.monotonic() + _ENDS_WITHIN_S
                for future in ends:
                    future.result(timeout=max(0.1, deadline - time.monotonic()))
        with suppress(Exception):
            self._client.close(timeout=2)

    def submit(self, address: str, name: str, request: bytes, needs: Mapping[str, tuple[int, int]]) -> Future[Any]:
        """Have a case executed on a worker."""
        return ask(self._client, address, {"do": "run", "name": name, "request": request, "needs": needs})

    def needs(self, trial: Trial, case: TestCase) -> dict[str, tuple[int, int]]:
        """Return how many of each scarce resource a trial needs, and how many there are in all.

        The scheduler remembers that total for as long as it runs, so it is part of the name.
        """
        file = self._context.file
        total = {name: file.resources.get(name, 1) for name in needed(file, file.components)}
        return {
            f"riot {file.system.name} {name} of {total[name]}": (count, total[name])
            for name, count in needed(file, _components(file, trial, case)).items()
        }

    def freed(self, worker: _ClusterWorker) -> None:
        """Take a worker back whose process has ended: it may begin with another one."""
        with self._lock:
            for address, state in self._states.items():
                if state.worker is worker:
                    state.worker, state.ready = None, False
                    if not self._closing.is_set() and not self._failed:
                        with suppress(Exception):  # the scheduler is gone, as the next look will show
                            self._begin(address, state)

    def _begin(self, address: str, state: WorkerState) -> None:
        state.name = uuid.uuid4().hex
        state.begun = ask(self._client, address, begin_of(self._context, self._facts, name=state.name, slot=state.slot))

    def _keep_looking(self) -> None:
        while not self._closing.wait(LOOK_S):
            try:
                self._look()
                self._check()
            except Exception as error:  # a scheduler that does not answer, in many ways
                if time.monotonic() - self._seen > _SCHEDULER_S:
                    _LOG.debug("the scheduler does not answer", exc_info=error)
                    self._fail(f"the scheduler has not answered for {_SCHEDULER_S:.0f} s")
            if self._failed:
                return

    def _look(self) -> None:
        """See which workers there are, and what they have said."""
        if self._client.status != "running":
            raise OSError(self._client.status)
        threads: dict[str, int] = self._client.nthreads()
        self._seen = time.monotonic()
        with self._lock:
            for worker in self._leaving:  # Dask has had time to say whether its case is to blame
                worker.leave()
            gone = [address for address in self._states if address not in threads]
            lost = [self._states.pop(address).worker for address in gone]
            self._leaving = [worker for worker in lost if worker]
            for address, count in threads.items():
                if address not in self._states:
                    self._add(address, count)
            came = [address for address, state in list(self._states.items()) if self._has_begun(address, state)]
        if came:
            self._wake()

    def _add(self, address: str, threads: int) -> None:
        used = {state.slot for state in self._states.values()}
        state = self._states[address] = WorkerState(min(set(range(len(used) + 1)) - used))
        state.refused = why_not(address, threads)
        if state.refused:
            _LOG.warning("%s is not used: %s", address, state.refused)
        else:
            self._begin(address, state)

    def _has_begun(self, address: str, state: WorkerState) -> bool:
        if state.begun is None or not state.begun.done():
            return False
        future, state.begun = state.begun, None
        try:
            found = msgpack.unpackb(future.result(timeout=_FETCH_S))
            state.refused = str(found.get("refused") or found.get("error") or "")
        except Exception:  # it has died meanwhile, or the connection has: the next look will show
            del self._states[address]
            return False
        state.ready = not state.refused
        if state.refused:
            _LOG.warning("%s is not used: %s", address, state.refused)
        return state.ready

    def _check(self) -> None:
        """Give up if there has been no worker for long, or if all workers refuse."""
        now, states = time.monotonic(), list(self._states.values())
        if any(not state.refused for state in states):
            self._had = now
        elif states or now - self._had > _WORKERS_S:
            told = "\n  ".join(f"{address}: {state.refused}" for address, state in self._states.items())
            if states and now - self._had > _SCHEDULER_S:
                self._fail(f"no worker takes trials:\n  {told}", "`riot cluster check` shows them")
            elif not states:
                self._fail(f"there has been no worker for {_WORKERS_S:.0f} s")

    def _fail(self, text: str, hint: str = "start it again") -> None:
        with self._lock:
            self._failed = EnvironmentFaultError(text, where=self._executor, hint=f"{hint}; {_HINT}")
            workers = [*self._leaving, *(state.worker for state in self._states.values() if state.worker)]
        for worker in workers:
            worker.leave()
        self._wake()


def _components(file: SystemFile, trial: Trial, case: TestCase) -> list[str]:
    """Return the components that run in a trial."""
    if not isinstance(trial, SystemTrial):
        return [file.component_of(trial.unit)]
    return [name for name, component in file.components.items() if not (case.messages and component.external)]


class _ClusterWorker:
    """A worker of the cluster and the process that it keeps, as a pool sees it."""

    folder = TRIAL

    def __init__(self, cluster: ClusterWorkers, address: str, name: str) -> None:
        self.link, self._theirs = Pipe(duplex=False)
        self._cluster, self._address, self._name = cluster, address, name
        self._future: Future[Any] | None = None
        self._found: dict[str, Any] = {}
        self._how: str | None = None
        self._leaving = threading.Lock()

    def ask(self, request: bytes, trial: Trial, case: TestCase) -> None:
        try:
            self._future = self._cluster.submit(self._address, self._name, request, self._cluster.needs(trial, case))
            self._future.add_done_callback(self._ended)
        except Exception:  # the scheduler is gone
            self.leave()

    def _ended(self, future: Future[Any]) -> None:
        """Receive the result of a case; called on a thread of Dask."""
        from distributed import KilledWorker

        try:
            self._found = msgpack.unpackb(self._result(future))
        except KilledWorker:
            self._how = f"with its worker {self._address}"
        except Exception as error:  # the task was cancelled, or the scheduler is gone
            _LOG.debug("%s: %s", self._address, error)
        if self._found.keys() & {"answer", "error"}:
            with suppress(OSError):
                self._theirs.send_bytes(b"")
        else:
            self._how = self._found.get("died", self._how)
            self.leave()

    def _result(self, future: Future[Any]) -> bytes:
        """Return the result of a case, which may be large; not waited for any more once its worker has left."""
        while True:
            try:
                data: bytes = future.result(timeout=_FETCH_S)
            except TimeoutError:
                if self._theirs.closed or future.status == "error":  # the case itself has raised it
                    raise
            else:
                return data

    def leave(self) -> None:
        """Tell the pool that this worker has ended, by closing the pipe; may be called on any thread."""
        with self._leaving:
            self._theirs.close()

    def cancel(self) -> None:
        """Cancel the case that it executes."""
        if self._future is not None and not self._future.done():
            self._future.cancel()

    def read(self, data: bytes, directory: Path) -> TrialAnswer:
        found, self._found, self._future = self._found, {}, None
        if "error" in found:
            raise RuntimeError(f"a worker has raised an error:\n{found['error']}")
        answer = read_answer(found["answer"])
        if found["left_out"]:
            size = f"{found['left_out'] >> 20} MiB, of which {MOST_FILES >> 20} come back from a worker"
            hint = "a long nominal log can be recorded by `riot record` and named in riot.toml ([system] nominal)"
            return replace(answer, outcome=Outcome(Verdict.ERROR, detail=f"the trial has left {size}; {hint}"))
        write_files(directory, found["files"])
        return answer

    def end(self) -> str | None:
        self.leave()
        self.link.close()
        self.cancel()
        self._cluster.freed(self)
        return self._how


def write_files(directory: Path, files: Mapping[str, bytes]) -> None:
    """Write the files that a trial has left on a worker into its folder here.

    Raises:
        ConfigError: A name leads out of the folder.
    """
    for name, data in files.items():
        parts = PurePosixPath(name)
        if parts.is_absolute() or ".." in parts.parts or not parts.parts:
            raise ConfigError(f"a worker has sent a file named {name!r}")
        path = directory / parts
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


@dataclass(frozen=True, slots=True)
class WorkerCheck:
    """The answer of a worker.

    Attributes:
        host: Name of its machine; empty if it has not answered.
    """

    address: str
    host: str
    refused: str


def check_cluster(executor: str, context: Context) -> list[WorkerCheck]:
    """Ask all workers of a cluster whether they would take trials of a system."""
    client = connect(executor)
    try:
        facts = facts_of(context)
        threads: dict[str, int] = client.nthreads()
        wrong = {address: why for address, count in threads.items() if (why := why_not(address, count))}
        asked = {
            address: ask(client, address, begin_of(context, facts, name=uuid.uuid4().hex, slot=None))
            for address in threads
            if address not in wrong
        }
        found = [WorkerCheck(address, "", why) for address, why in wrong.items()]
        for address, future in asked.items():
            try:
                told = msgpack.unpackb(future.result(timeout=FACTS_WITHIN_S))
                why = str(told.get("refused") or told.get("error") or "")
                found.append(WorkerCheck(address, str(told.get("host", "")), why))
            except Exception as error:
                found.append(WorkerCheck(address, "", f"no answer: {type(error).__name__} {error}".strip()))
        return sorted(found, key=lambda each: each.address)
    finally:
        client.close()
