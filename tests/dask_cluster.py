"""A Dask cluster on loopback, of a scheduler and workers as `dask scheduler` and `dask worker` start them."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Self

import psutil

from riot_bus.zenoh.session import wait_until

__all__ = ["DaskCluster"]


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
    return port


class DaskCluster:
    """A context manager that leaves no process behind.

    Each worker has a folder for temporary files of its own, as if it were on a machine of its own.

    Args:
        folder: Where the processes write.
        workers: How many.
        environment: Added to that of the processes.
        tls: Whether its processes speak TLS, with the certificates that the environment names.
    """

    def __init__(
        self, folder: Path, workers: int, environment: Mapping[str, str] | None = None, *, tls: bool = False
    ) -> None:
        self.folder, self.count = folder, workers
        self._scheme, self._protocol = ("tls", ("--protocol=tls",)) if tls else ("tcp", ())
        self.port = _free_port()
        self.executor = f"dask://127.0.0.1:{self.port}"
        leases = {"LEASE_TIMEOUT": "3s", "LEASE_VALIDATION_INTERVAL": "500ms"}
        locks = {f"DASK_DISTRIBUTED__SCHEDULER__LOCKS__{name}": value for name, value in leases.items()}
        allowed = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
        self._environment = os.environ | locks | allowed | dict(environment or {})
        self.scheduler: subprocess.Popen[bytes]
        self.nannies: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def start(self) -> None:
        """Start all of it, and wait until the scheduler listens."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self.scheduler = self._dask(
            "scheduler", "--host=127.0.0.1", f"--port={self.port}", "--no-dashboard", *self._protocol
        )
        assert wait_until(self._listens, 60)
        for number in range(self.count):
            self.start_worker(number)

    def start_worker(self, number: int, *options: str, **environment: str) -> None:
        """Start a worker."""
        own = self.folder / f"worker{number}"
        own.mkdir(exist_ok=True)
        address = f"{self._scheme}://127.0.0.1:{self.port}"
        common = (address, "--host=127.0.0.1", "--memory-limit=0", "--no-dashboard", *self._protocol)
        options = options or ("--nthreads=1",)
        self.nannies.append(
            self._dask("worker", *common, *options, f"--local-directory={own}", TMPDIR=str(own), **environment)
        )

    def _dask(self, *arguments: str, **environment: str) -> subprocess.Popen[bytes]:
        with (self.folder / f"{arguments[0]}.log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "dask", *arguments],
                stdout=log,
                stderr=log,
                env=self._environment | environment,
            )

    def _listens(self) -> bool:
        try:
            socket.create_connection(("127.0.0.1", self.port), 1).close()
        except OSError:
            return False
        return True

    def worker_processes(self) -> list[psutil.Process]:
        """Return the processes of Dask's workers that keep a process of riot, each below its nanny."""
        found = [child for nanny in self.nannies for child in _children(nanny.pid)]
        return [each for each in found if _children(each.pid)]

    def registered(self) -> int:
        """Return how many workers the scheduler has taken in."""
        return (self.folder / "scheduler.log").read_text().count("Register worker")

    def kill(self) -> None:
        """Kill all of it."""
        processes = [self.scheduler, *self.nannies]
        below = [each for one in processes for each in _children(one.pid, recursive=True)]
        for one in (*processes, *below):
            one.kill()
        for process in processes:
            process.wait()
        psutil.wait_procs(below, 30)
        self.nannies.clear()


def _children(pid: int, *, recursive: bool = False) -> list[psutil.Process]:
    try:
        return psutil.Process(pid).children(recursive=recursive)
    except psutil.NoSuchProcess:
        return []
