"""What riot costs between two ends of MAVLink: `python benchmarks/mavlink_bridge.py [--json FILE] [--quick]`.

One process sends ATTITUDE over UDP, one frame in each packet, and gets it again over UDP behind: nothing (the sockets
alone), a forwarding loop of pymavlink, the same with one field changed, a `riot bridge mavlink` that is its own router
(untouched, and with one field patched), two links of one segment, and two segments of a `riot router` elsewhere,
un-intercepted and with one field patched, with one bridge for both segments and with one for each. Everything between
is processes of its own. Throughput is that of a window of frames that are under way; nothing may be lost. Delays are
those of a steady rate. In each round all ways are measured in turn; ratios are those of one round: to the plain loop of
pymavlink, and to the one that does the same.

ATTITUDE is always of the same length, and the bridge can send many such frames with one call. `--traffic mixed` sends
what an autopilot does, each frame of another length than the one before.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import select
import signal
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

import psutil

from riot_bus_bridges.links.packets import Packets
from riot_bus_mavlink.dialect import load_dialect
from riot_bus_mavlink.frame import pack_frame

WAYS = (
    "sockets alone",
    "pymavlink loop",
    "pymavlink loop, patched",
    "own router, native",
    "own router, patched",
    "one segment",
    "native",
    "patched",
    "two bridges, patched",
)
JUDGED = "own router, patched"
PEER = "pymavlink loop"
WINDOW = 256
TARGET_RATE, TARGET_RATIO, TARGET_DELAY_US = 20_000, 3.0, 150.0
PATCHED_ROLL = struct.pack("<f", 0.25)
TIMEOUT_S = 30.0
RIOT = [sys.executable, "-m", "riot_bus"]
ATTITUDE = 30
STREAM = (
    "ATTITUDE", "GLOBAL_POSITION_INT", "VFR_HUD", "RAW_IMU", "SERVO_OUTPUT_RAW", "ATTITUDE", "SYS_STATUS",
    "GPS_RAW_INT", "NAV_CONTROLLER_OUTPUT", "HEARTBEAT",
)  # fmt: skip
FIRST_STEADY = 1 << 24


def frames(count: int, *, first: int = 0) -> list[bytes]:
    """Return ATTITUDE frames; `time_boot_ms` is the number of the frame, beginning with `first`."""
    extra = load_dialect("common").crc_extra(ATTITUDE)
    assert extra is not None
    payload = struct.Struct("<I6f")
    return [
        pack_frame(
            ATTITUDE,
            payload.pack(number, 1.5, 0.1, 0.2, 0.3, 0.4, 0.5),
            extra,
            version=2,
            sequence=number,
            system=1,
            component=1,
        )
        for number in range(first, first + count)
    ]


def mixed(count: int) -> list[bytes]:
    """Return frames of what an autopilot sends in turn, so that each has another length than the one before."""
    dialect = load_dialect("common")
    found = []
    for number in range(count):
        message = dialect.message(STREAM[number % len(STREAM)])
        assert message is not None
        body = bytes((number + at) % 255 + 1 for at in range(message.size))
        found.append(pack_frame(message.id, body, message.crc_extra, version=2, sequence=number, system=1, component=1))
    return found


def udp_socket() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
        made.setsockopt(socket.SOL_SOCKET, option, 1 << 22)
    made.bind(("127.0.0.1", 0))
    made.settimeout(0)
    return made


class Way:
    """What is between the two sockets, in processes of its own; a context manager."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name = name
        self.patched = name.endswith("patched")
        self.out, self.back = udp_socket(), udp_socket()
        self.processes: list[psutil.Process] = []
        self._folder = folder
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with self._stack as stack:
            stack.callback(self.out.close)
            stack.callback(self.back.close)
            self.out.connect(("127.0.0.1", self._open(int(self.back.getsockname()[1]))))
            self._warm_up()
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def _open(self, port: int) -> int:
        if self.name == "sockets alone":
            return port
        if self.name.startswith(PEER):
            words = [sys.executable, __file__, "--forward", str(port), *(["--patch"] if self.patched else [])]
            return int(self._start(words).split()[1])
        injected = []
        if self.patched:
            plan = self._folder / "plan.toml"
            plan.write_text('[[inject]]\ntopic = "mavlink_raw/fc/1/1/ATTITUDE"\nfield = "roll"\nvalue = 0.25\n')
            injected = [f"--inject={plan}"]
        bridge = [*RIOT, "bridge", "mavlink", "--format=json"]
        if self.name.startswith("own router"):
            links = ["--link=system/fc=udpin:127.0.0.1:0", f"--link=unit/gcs=udpout:127.0.0.1:{port}"]
            listen = ["--listen=system=tcp/127.0.0.1:0", "--listen=unit=tcp/127.0.0.1:0"]
            return self._port(self._start([*bridge, *listen, *injected, *links]))
        router = ["router", "--segment=system=tcp/127.0.0.1:0", "--segment=unit=tcp/127.0.0.1:0", *injected]
        segments = dict(re.findall(r"segment (\w+) ([^\s,;]+)", self._start([*RIOT, *router])))
        unit = "unit"
        if self.name == "one segment":
            unit = "system"
            del segments["unit"]
        named = [f"--segment={name}={where}" for name, where in segments.items()]
        links = ["--link=system/fc=udpin:127.0.0.1:0", f"--link={unit}/gcs=udpout:127.0.0.1:{port}"]
        if self.name.startswith("two bridges"):
            self._start([*bridge, named.pop(), links.pop()])
        return self._port(self._start([*bridge, *named, *links]))

    @staticmethod
    def _port(line: str) -> int:
        return int(json.loads(line)["links"]["fc"]["where"].rpartition(":")[2])

    def _start(self, words: list[str]) -> str:
        """Start a process; return the line by which it says that it is ready."""
        process = self._stack.enter_context(subprocess.Popen(words, stdout=subprocess.PIPE, text=True))
        self._stack.callback(process.send_signal, signal.SIGTERM)
        self.processes.append(psutil.Process(process.pid))
        assert process.stdout is not None
        return process.stdout.readline()

    def _warm_up(self) -> None:
        deadline = time.monotonic() + TIMEOUT_S
        while time.monotonic() < deadline:
            self.flood(frames(1)[:1] * 64, patience=0.5)
            if self.flood(frames(1) * 2000, patience=1.0)[1] >= 2000:
                self.drain()
                return
        raise TimeoutError(f"{self.name}: frames do not arrive")

    def drain(self) -> None:
        """Wait until nothing comes any more."""
        while select.select([self.back], [], [], 0.3)[0]:
            self.back.recv(300)

    def flood(self, raws: list[bytes], *, patience: float = 5.0) -> tuple[float, int, float]:
        """Send frames, so many under way; return frames/s, how many came, and processor seconds of what is between."""
        send, fetched = self.out.send, Packets(self.back)  # the fastest that there is, else the ends would be measured
        count, sent, came = len(raws), 0, 0
        used = self.used()
        begin = time.perf_counter()
        while came < count:
            while sent < count and sent - came < WINDOW:
                send(raws[sent])
                sent += 1
            if not select.select([self.back], [], [], patience)[0]:
                break
            came += sum(len(packets) for _, packets in fetched.receive())
        return came / (time.perf_counter() - begin), came, self.used() - used

    def used(self) -> float:
        """Return the processor seconds that the processes between have used."""
        return sum(sum(process.cpu_times()[:2]) for process in self.processes)

    def delays(self, raws: list[bytes], *, rate: float) -> list[float]:
        """Send frames at a steady rate; return how long each took, in microseconds."""
        sent = [0] * len(raws)
        found: list[float] = []
        due = time.perf_counter()
        for number, raw in enumerate(raws):
            due += 1 / rate
            while (left := due - time.perf_counter()) > 0:
                self._receive(sent, found, left)
            sent[number] = time.perf_counter_ns()
            self.out.send(raw)
        deadline = time.perf_counter() + 2
        while len(found) < len(raws) and (left := deadline - time.perf_counter()) > 0:
            self._receive(sent, found, left)
        return found

    def _receive(self, sent: list[int], found: list[float], seconds: float) -> None:
        if not select.select([self.back], [], [], seconds)[0]:
            return
        now = time.perf_counter_ns()
        raw = self.back.recv(300)
        if self.patched and raw[14:18] != PATCHED_ROLL:
            raise AssertionError(f"{self.name}: the field is not patched")
        number = int.from_bytes(raw[10:14], "little") - FIRST_STEADY
        if number >= 0:  # else it is late, from before
            found.append((now - sent[number]) / 1000)


def forward(port: int, *, patch: bool) -> None:
    """Be the loop that people write with pymavlink: from a port of ours to another one."""
    os.environ["MAVLINK20"] = "1"
    from pymavlink import mavutil

    probe = udp_socket()
    here = probe.getsockname()[1]
    probe.close()
    source = mavutil.mavlink_connection(f"udpin:127.0.0.1:{here}")
    sink = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}")
    source.port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
    print("ready", here, flush=True)
    while True:
        message = source.recv_match(blocking=True)
        if message is None:
            continue
        if patch and message.get_type() == "ATTITUDE":
            message.roll = 0.25
            sink.mav.srcSystem, sink.mav.srcComponent = message.get_srcSystem(), message.get_srcComponent()
            sink.mav.seq = message.get_seq()
            sink.write(message.pack(sink.mav))
        else:
            sink.write(message.get_msgbuf())


def measure(
    ways: list[str], *, traffic: str, rounds: int, count: int, rate: float, seconds: float, folder: Path
) -> dict[str, Any]:
    """Return what each way did in each round."""
    found: dict[str, dict[str, list[float]]] = {
        name: {"rate": [], "cpu_us": [], "p50": [], "p99": [], "lost": []} for name in ways
    }
    flood = mixed(count) if traffic == "mixed" else frames(count)
    steady = frames(int(rate * seconds), first=FIRST_STEADY)
    for _ in range(rounds):
        for name in ways:
            with Way(name, folder) as way:
                per_second, came, used = way.flood(flood)
                way.drain()
                delays = sorted(way.delays(steady, rate=rate))
            result = found[name]
            result["rate"].append(per_second)
            result["lost"].append(count - came + len(steady) - len(delays))
            result["cpu_us"].append(used / count * 1e6)
            result["p50"].append(delays[len(delays) // 2])
            result["p99"].append(delays[int(len(delays) * 0.99)])
            print(f"{name:24} {per_second:8.0f}/s  p50 {result['p50'][-1]:6.0f} us", file=sys.stderr)
    return found


def table(found: dict[str, dict[str, list[float]]]) -> list[str]:
    """Return rows: medians, and the ratios to the peers in the same round."""
    heads = ("frames/s", "x plain", "x same", "CPU us", "p50 us", "added", "p99 us", "lost")
    rows = [f"{'':24} " + " ".join(f"{head:>8}" for head in heads)]
    for name, result in found.items():
        same = PEER + (", patched" if name.endswith("patched") else "")
        ratios = [
            statistics.median(mine / other for mine, other in zip(result["rate"], found[peer]["rate"], strict=True))
            for peer in (PEER, same)
        ]
        numbers = {key: statistics.median(values) for key, values in result.items()}
        rows.append(
            f"{name:24} {numbers['rate']:8.0f} {ratios[0]:8.2f} {ratios[1]:8.2f} {numbers['cpu_us']:8.1f} "
            f"{numbers['p50']:8.0f} {added(found, name):8.0f} {numbers['p99']:8.0f} {sum(result['lost']):8.0f}"
        )
    return rows


def added(found: dict[str, dict[str, list[float]]], name: str) -> float:
    """Return the median over all rounds of what a way adds to the median delay, in microseconds."""
    pairs = zip(found[name]["p50"], found["sockets alone"]["p50"], strict=True)
    return statistics.median(mine - bare for mine, bare in pairs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="write all figures there")
    parser.add_argument("--quick", action="store_true", help="one short round")
    parser.add_argument(
        "--way", action="append", choices=WAYS, help="measure only these, and what they are compared to"
    )
    parser.add_argument(
        "--traffic",
        choices=("ATTITUDE", "mixed"),
        default="ATTITUDE",
        help="what the throughput is measured with: always the same message, or those that an autopilot sends",
    )
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--rate", type=float, default=1000.0, help="frames/s when delays are measured")
    parser.add_argument("--forward", type=int, metavar="PORT", help="be the loop of pymavlink")
    parser.add_argument("--patch", action="store_true", help="change a field there")
    options = parser.parse_args()
    if options.forward:
        forward(options.forward, patch=options.patch)
    rounds, count, seconds = (1, 20_000, 1.0) if options.quick else (options.rounds, 100_000, 5.0)
    with tempfile.TemporaryDirectory() as folder:
        needed = {WAYS[0], PEER, f"{PEER}, patched", *(options.way or WAYS)}
        ways = [name for name in WAYS if name in needed]
        found = measure(
            ways,
            traffic=options.traffic,
            rounds=rounds,
            count=count,
            rate=options.rate,
            seconds=seconds,
            folder=Path(folder),
        )
    print(
        f"{options.traffic}, {WINDOW} frames under way; delays at {options.rate:g} frames/s; {rounds} rounds, medians"
    )
    print("\n".join(table(found)))
    print(
        f"targets, of {JUDGED!r}: >= {TARGET_RATE} frames/s, >= {TARGET_RATIO:g} x peer, "
        f"added p50 <= {TARGET_DELAY_US:g} us"
    )
    if options.json:
        place = {
            "python": platform.python_version(),
            "cpus": os.cpu_count(),
            "window": WINDOW,
            "rate": options.rate,
            "traffic": options.traffic,
        }
        options.json.write_text(json.dumps({"where": place, "found": found}, indent=1))


if __name__ == "__main__":
    main()
