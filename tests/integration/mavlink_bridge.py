"""A running `riot bridge mavlink` in a process of its own, and ends of its links."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import time
from typing import Any, Self

from riot_bus_mavlink.dialect import load_dialect
from riot_bus_mavlink.frame import Frame, Framer
from tests.integration.router_process import ENVIRONMENT, RIOT

WAIT_S = 60.0


class MavlinkBridgeProcess:
    """The test's end.

    Args:
        segments: Endpoints by name; None if the bridge is its own router.
        links: As `--link` takes them.
        options: More of the command's options.
    """

    def __init__(self, segments: dict[str, str] | None, links: list[str], *options: str) -> None:
        own = [] if segments is not None else [f"--listen={name}=tcp/127.0.0.1:0" for name in ("system", "unit")]
        self.router: dict[str, Any] = {}
        """What the bridge has said at its end as its own router."""
        self.process = subprocess.Popen(
            [
                *RIOT,
                *("bridge", "mavlink", "--format=json"),
                *(f"--segment={name}={endpoint}" for name, endpoint in (segments or {}).items()),
                *([] if any(each.startswith("--listen") for each in options) else own),
                *(f"--link={link}" for link in links),
                *options,
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=ENVIRONMENT,
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, self.process.communicate(timeout=WAIT_S)
        self.ready: dict[str, Any] = json.loads(line)

    def address(self, link: str) -> tuple[str, int]:
        host, _, port = self.ready["links"][link]["where"].rpartition(":")
        return host, int(port)

    def end(self) -> dict[str, Any]:
        """End it; return its last status."""
        self.process.send_signal(signal.SIGTERM)
        out, err = self.process.communicate(timeout=60)
        assert (self.process.returncode, err) == (0, ""), err
        found: list[dict[str, Any]] = [json.loads(line) for line in out.splitlines()]
        self.router = found[-1]
        return found[0]

    def endpoint(self, segment: str) -> str:
        """Return where a segment listens."""
        return str(self.ready["segments"][segment]["endpoint"])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.process.kill()
        self.process.communicate(timeout=60)


class UdpEnd:
    """A UDP socket that sends and gets frames.

    Args:
        target: Where to; None for wherever something came from last.
    """

    def __init__(self, target: tuple[str, int] | None = None) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 21)  # for what comes before it is read
        self._socket.bind(("127.0.0.1", 0))
        self._target = target
        self._framer = Framer(load_dialect().crc_extra)
        self._ready: list[Frame] = []

    @property
    def port(self) -> int:
        return int(self._socket.getsockname()[1])

    def send(self, *payloads: bytes) -> None:
        assert self._target is not None
        for payload in payloads:
            self._socket.sendto(payload, self._target)

    def get(self, seconds: float = WAIT_S) -> Frame | None:
        """Return the next frame, None if there is none for so long."""
        deadline = time.monotonic() + seconds
        while not self._ready:
            self._socket.settimeout(max(0.001, deadline - time.monotonic()))
            try:
                data, address = self._socket.recvfrom(65535)
            except TimeoutError:
                if time.monotonic() >= deadline:
                    return None
                continue
            self._target = address
            self._ready += self._framer.feed(data)
        return self._ready.pop(0)

    def take(self, count: int) -> list[Frame]:
        """Return so many frames."""
        found = [self.get() for _ in range(count)]
        return [frame for frame in found if frame is not None]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._socket.close()
