"""Messages per second that recorders take from a Zenoh router to an MCAP file, beside each other in one run.

python benchmarks/record.py [--json FILE] [--rounds N] [--keelson PYTHON --keelson-recorder keelson2mcap.py]

A publisher floods a router without loss; a recorder takes all of it. Time is from the first message until the
recorder's process rests again. Compared are `riot record`, a callback that writes with the plain `mcap` writer (the
least that can be called a recorder), and keelson's recorder, if it is named: PYTHON has the package `keelson`,
keelson2mcap.py is of its connector `mcap`. That one ends itself when its queue grows, so this guard is switched off,
to its favour. The writers alone, from memory, are measured too. Every recorder and the publisher is a process of its
own; in each round all come once per size, and ratios are those of the same round.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

import psutil
from common import started
from mcap.reader import make_reader
from mcap.writer import Writer

from riot_bus.log.writer import LogSettings, LogWriter
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.session import free_endpoint

ENDS = Path(__file__).with_name("record_ends.py")
KEY = "bench/@v0/rover/pubsub/raw/lidar"  # as keelson wants keys to be
SIZES = {64: 200_000, 1024: 100_000, 1 << 20: 400}
POOL_BYTES = 1 << 23
LOOK_S = 0.1
RESTS = 0.12  # of a processor: less is rest, a keelson recorder polls its queue
ENCLOSE = """
import pathlib, sys, keelson
for path in sorted(pathlib.Path(sys.argv[1]).iterdir()):
    path.write_bytes(keelson.enclose(path.read_bytes()))
"""
UNGUARDED = """
import runpy, sys
import keelson.scaffolding
keelson.scaffolding.check_queue_backpressure = lambda *arguments, **options: None
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@dataclass(frozen=True)
class Run:
    """What one recorder did once."""

    recorder: str
    size: int
    round: int
    sent: int
    recorded: int
    counted_lost: int
    per_second: float
    processor_us: float  # of the recorder's process, by message

    @property
    def unaccounted(self) -> int:
        """Messages that are neither in the file nor said to be lost."""
        return self.sent - self.recorded - self.counted_lost


def payloads(folder: Path, size: int, keelson: str | None) -> Path:
    """Fill a folder with different payloads that cannot be compressed."""
    folder.mkdir()
    for number in range(max(4, min(64, POOL_BYTES // size))):
        (folder / f"{number:03}").write_bytes(os.urandom(size))
    if keelson is not None:
        subprocess.run([keelson, "-c", ENCLOSE, str(folder)], check=True)
    return folder


def rest(process: psutil.Process) -> float:
    """Wait until a process does next to nothing; return when that began."""
    before, quiet, since = process.cpu_times(), 0, time.monotonic()
    while quiet < 5:
        time.sleep(LOOK_S)
        now = process.cpu_times()
        busy = now.user + now.system - before.user - before.system > RESTS * LOOK_S
        before = now
        quiet = 0 if busy else quiet + 1
        if busy:
            since = time.monotonic()
    return since


def command(recorder: str, endpoint: str, folder: Path, options: argparse.Namespace) -> list[str]:
    path = str(folder / "log.mcap")
    if recorder == "bare mcap":
        return [sys.executable, str(ENDS), "bare", endpoint, KEY, path]
    if recorder == "keelson":
        words = [
            options.keelson,
            "-c",
            UNGUARDED,
            options.keelson_recorder,
            "--mode=client",
            "--connect",
            endpoint,
            "-k",
            KEY,
        ]
        return [*words, "--output-folder", str(folder), "--file-name=log", "--log-level=40", "--bypass-safeguards"]
    more = ["--no-durable"] if "durable" in recorder else []
    words = [sys.executable, "-m", "riot_bus", "record", KEY, "-e", endpoint, "-o", path, "--format=json"]
    return [*words, "--no-control", *more]


def measure(recorder: str, size: int, number: int, pool: Path, options: argparse.Namespace) -> Run:
    endpoint, count = free_endpoint(), max(10, int(SIZES[size] * options.scale))
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(dir=options.folder)))

        router = started([sys.executable, str(ENDS), "router", endpoint], stack)
        assert router.stdout is not None
        assert router.stdout.readline()
        recording = started(command(recorder, endpoint, folder, options), stack)
        publisher = started([sys.executable, str(ENDS), "publish", endpoint, KEY, str(count), "0", str(pool)], stack)
        assert publisher.stdin is not None
        assert publisher.stdout is not None
        publisher.stdout.readline()
        process = psutil.Process(recording.pid)
        rest(process)
        used = process.cpu_times()
        publisher.stdin.write("\n")
        publisher.stdin.flush()
        times = json.loads(publisher.stdout.readline())
        ended = rest(process)
        spent = process.cpu_times()
        seconds = spent.user + spent.system - used.user - used.system
        recording.send_signal(signal.SIGINT)
        said, _ = recording.communicate(timeout=120)
        lost = 0
        if recorder.startswith("riot"):
            result = json.loads(said.splitlines()[-1])
            lost = sum(sum(topics.values()) for topics in result["lost"].values())
        rate = count / (ended - times["began"])
        return Run(recorder, size, number, count, in_file(folder / "log.mcap"), lost, rate, seconds / count * 1e6)


def in_file(path: Path) -> int:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    return summary.statistics.message_count


def writers(size: int, number: int, pool: Path, options: argparse.Namespace) -> list[Run]:
    """Write from memory."""
    count = max(10, int(SIZES[size] * options.scale))
    bodies = [path.read_bytes() for path in sorted(pool.iterdir())]
    log = [Message(10**18 + n * 1000, KEY, bodies[n % len(bodies)], sequence=n) for n in range(count)]
    runs = []
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        path = Path(folder, "log.mcap")
        used = _processor()
        began = time.perf_counter()
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            channel = writer.register_channel(KEY, "", 0)
            for each in log:
                writer.add_message(channel, each.time, each.payload, each.time, each.sequence)
            writer.finish()  # type: ignore[no-untyped-call]
        took = time.perf_counter() - began
        runs.append(Run("mcap writer alone", size, number, count, in_file(path), 0, count / took, used() / count * 1e6))
        used = _processor()
        began = time.perf_counter()
        with LogWriter(path, LogSettings(threaded=True)) as ours:
            for each in log:
                ours.write(each)
        took = time.perf_counter() - began
        runs.append(Run("LogWriter alone", size, number, count, in_file(path), 0, count / took, used() / count * 1e6))
    return runs


def _processor() -> Callable[[], float]:
    began = time.process_time()
    return lambda: time.process_time() - began


def table(runs: list[Run]) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    rate = {(run.recorder, run.size, run.round): run.per_second for run in runs}
    for size in dict.fromkeys(run.size for run in runs):
        for name in dict.fromkeys(run.recorder for run in runs):
            mine = [run for run in runs if (run.recorder, run.size) == (name, size)]

            def ratio(anchor: str, mine: list[Run] = mine) -> float | None:
                found = [
                    run.per_second / rate[anchor, run.size, run.round]
                    for run in mine
                    if (anchor, run.size, run.round) in rate
                ]
                return round(statistics.median(found), 2) if found else None

            rows.append(
                {
                    "recorder": name,
                    "payload_bytes": size,
                    "messages_per_second": round(statistics.median(run.per_second for run in mine)),
                    "to_bare_mcap": ratio("mcap writer alone" if name.endswith("alone") else "bare mcap"),
                    "to_writer_in_memory": ratio("mcap writer alone"),
                    "to_keelson": None if name.endswith("alone") else ratio("keelson"),
                    "processor_us": round(statistics.median(run.processor_us for run in mine), 1),
                    "sent": sum(run.sent for run in mine),
                    "in_files": sum(run.recorded for run in mine),
                    "counted_lost": sum(run.counted_lost for run in mine),
                    "unaccounted": sum(run.unaccounted for run in mine),
                }
            )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="write all figures there")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--scale", type=float, default=1.0, help="of the numbers of messages")
    parser.add_argument("--folder", type=Path, help="where logs are written; by default as of TMPDIR")
    parser.add_argument("--keelson", help="a Python with the package keelson")
    parser.add_argument("--keelson-recorder", help="its keelson2mcap.py")
    parser.add_argument("--sizes", type=int, nargs="*", default=list(SIZES), choices=list(SIZES), help="of payloads")
    options = parser.parse_args()
    names = ["bare mcap", "riot record", "riot record, not durable"]
    if options.keelson and options.keelson_recorder:
        names.append("keelson")
    runs: list[Run] = []
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        for size in options.sizes:
            pool = payloads(Path(folder, str(size)), size, options.keelson)
            for number in range(options.rounds):
                runs += writers(size, number, pool, options)
                for name in names:
                    runs.append(measure(name, size, number, pool, options))
                    print(f"{runs[-1].recorder}, {size} bytes: {runs[-1].per_second:,.0f} msg/s", file=sys.stderr)
    rows = table(runs)
    if options.json:
        machine = {"system": platform.platform(), "processors": os.cpu_count(), "python": platform.python_version()}
        document = {"machine": machine, "table": rows, "runs": [asdict(run) for run in runs]}
        options.json.write_text(json.dumps(document, indent=2))
    heads = list(rows[0])
    print("  ".join([f"{heads[0]:25}", *(f"{head:>20}" for head in heads[1:])]))
    for row in rows:
        cells = ["-" if row[head] is None else f"{row[head]:,}" for head in heads[1:]]
        print("  ".join([f"{row['recorder']:25}", *(f"{cell:>20}" for cell in cells)]))
    if "keelson" not in names:
        print("keelson's recorder was left out: --keelson and --keelson-recorder name it")


if __name__ == "__main__":
    main()
