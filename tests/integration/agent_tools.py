"""Running agents and controllers, and a link between them that can be cut and restored."""

from __future__ import annotations

import contextlib
import json
import queue
import socket
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Self

from tests.integration.router_process import ENVIRONMENT, RIOT, riot


class Cable:
    """Forwards TCP connections to an endpoint; can be cut, which ends them all, and restored.

    Args:
        endpoint: Such as `tcp/127.0.0.1:7447`.
    """

    def __init__(self, endpoint: str) -> None:
        host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
        self._target = (host, int(port))
        self._lock = threading.Lock()
        self._sockets: set[socket.socket] = set()
        self._threads: list[threading.Thread] = []
        self._listener: socket.socket | None = None
        self._port = 0
        self._flowing = threading.Event()
        self._flowing.set()
        self.delay = 0.0
        self.restore()

    @property
    def endpoint(self) -> str:
        return f"tcp/127.0.0.1:{self._port}"

    def restore(self) -> None:
        listener = socket.create_server(("127.0.0.1", self._port))
        self._port = listener.getsockname()[1]
        self._listener = listener
        self._spawn(self._accept, listener)

    def freeze(self) -> None:
        """Let nothing through any more, but close nothing: a pulled plug."""
        self._flowing.clear()

    def thaw(self) -> None:
        """Let all through again, what came meanwhile too."""
        self._flowing.set()

    def cut(self) -> None:
        self._flowing.set()
        with self._lock:
            listener, self._listener = self._listener, None
            if listener is not None:
                with contextlib.suppress(OSError):
                    listener.shutdown(socket.SHUT_RDWR)
                listener.close()
            for each in self._sockets:
                with contextlib.suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join(10)
        self._threads.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.cut()

    def _spawn(self, target: Any, *arguments: Any) -> None:
        thread = threading.Thread(target=target, args=arguments, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self, listener: socket.socket) -> None:
        while True:
            try:
                near, _ = listener.accept()
            except OSError:
                return
            with self._lock:
                if self._listener is not listener:
                    near.close()
                    return
                try:
                    far = socket.create_connection(self._target, timeout=10)
                except OSError:
                    near.close()
                    continue
                far.settimeout(None)
                self._sockets |= {near, far}
                self._spawn(self._pump, near, far)
                self._spawn(self._pump, far, near)

    def _pump(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(1 << 16):
                self._flowing.wait()
                if self.delay:
                    time.sleep(self.delay)
                sink.sendall(data)
        for each in (source, sink):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
        with self._lock:
            last = source not in self._sockets
            self._sockets -= {source, sink}
        if last:  # the thread of the other direction has ended
            source.close()
            sink.close()


class Process:
    """A `riot` command whose lines can be waited for.

    Args:
        arguments: Command and options.
        inside: A command that runs it somewhere else.
    """

    def __init__(self, *arguments: str, inside: Sequence[str] = ()) -> None:
        self.process = subprocess.Popen(
            [*inside, *RIOT, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            text=True,
            env=ENVIRONMENT,
        )
        self.out: list[str] = []
        self.err: list[str] = []
        self._queue: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._threads = [
            threading.Thread(target=self._read, args=(stream, lines), daemon=True)
            for stream, lines in ((self.process.stdout, self.out), (self.process.stderr, self.err))
        ]
        for thread in self._threads:
            thread.start()

    def expect(self, text: str, timeout: float = 60) -> str:
        """Return the next line, of either stream, that holds a text."""
        while True:
            try:
                line = self._queue.get(timeout=timeout)
            except queue.Empty:
                raise AssertionError(f"{text!r} did not come: {self.out} {self.err}") from None
            if text in line:
                return line

    def end(self, timeout: float = 90) -> int:
        code = self.process.wait(timeout)
        for thread in self._threads:
            thread.join(10)
        return code

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.process.kill()
        self.end(20)
        for stream in (self.process.stdout, self.process.stderr):
            assert stream is not None
            stream.close()

    def _read(self, stream: Any, lines: list[str]) -> None:
        for line in stream:
            lines.append(line.rstrip("\n"))
            self._queue.put(lines[-1])


@contextlib.contextmanager
def agent(logs: Path, bus: str, fleet: str, *arguments: str, robot: str = "r7", wait: bool = True) -> Iterator[Process]:
    """An agent that is connected."""
    with Process(
        "agent", f"--robot={robot}", f"--logs={logs}", f"--endpoint={bus}", f"--fleet={fleet}", *arguments
    ) as process:
        if wait:
            process.expect("connected to the fleet router")
        yield process


def fleet(endpoint: str, *arguments: str, code: int = 0) -> Any:
    """Run a command of `riot fleet`; return its JSON, or what it said on stderr if it fails as it should."""
    found, out, err = riot("fleet", *arguments, f"--endpoint={endpoint}", "--format=json")
    assert found == code, (found, out, err)
    return json.loads(out) if code == 0 else err
