"""Kill `riot record` at random moments and look at what is left.

python benchmarks/record_kill.py [--json FILE] [--times N]

Each time a publisher sends 20,000 numbered messages per second through a router to the recorder and to a plain
subscriber; after a random while the recorder is killed (SIGKILL). Then `riot info` and a reader say what is in the
file. It holds when every file opens, nothing is missing in the middle, what the file holds is what the subscriber
saw, and no more is gone than what came within the age of a chunk (1 s) and a second for the way to the file.
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

from common import started

from riot_bus.log.reader import LogReader
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import free_endpoint

RATE = 20_000
KEY = "kill/numbers"
CHUNK_S = 1.0
SLACK_S = 1.0
ENDS = Path(__file__).with_name("record_ends.py")


@dataclass(frozen=True)
class Killed:
    """What one kill has left."""

    after_s: float
    rate: float
    seen: int
    in_file: int
    info: int
    gap: bool
    differs: bool
    lost_s: float
    unfinished: bool

    @property
    def holds(self) -> bool:
        """Whether the promise was kept."""
        return (
            not self.gap
            and not self.differs
            and self.unfinished
            and self.info == self.in_file
            and self.lost_s <= CHUNK_S + SLACK_S
        )


def kill_once(endpoint: str, folder: Path, pool: Path, after: float) -> Killed:
    path = folder / "log.mcap"
    path.unlink(missing_ok=True)
    words = [sys.executable, "-m", "riot_bus", "record", KEY, "-e", endpoint, "-o", str(path), "--no-control"]
    with ExitStack() as stack:
        recorder = started([*words, "--format=json"], stack)
        assert recorder.stdout is not None
        assert json.loads(recorder.stdout.readline())["event"] == "started"
        client = stack.enter_context(open_client(endpoint))
        seen: list[Message] = []
        client.subscribe(KEY, seen.append)
        for _ in client.session.get("nobody/answers", timeout=1.0):
            pass  # the router has taken the subscription in
        publisher = started(
            [sys.executable, str(ENDS), "publish", endpoint, KEY, "1000000", str(RATE), str(pool)], stack
        )
        assert publisher.stdin is not None
        assert publisher.stdout is not None
        publisher.stdout.readline()
        publisher.stdin.write("\n")
        publisher.stdin.flush()
        while not seen:
            time.sleep(0.001)
        time.sleep(after)
        recorder.send_signal(signal.SIGKILL)
        killed_at = time.time_ns()
        recorder.wait()
        with LogReader(path) as reader:
            found = list(reader.messages())
            unfinished = reader.loss.unfinished
        while found and number_of(seen[-1]) < number_of(found[-1]):
            time.sleep(0.001)  # the subscriber may be behind
        publisher.kill()
    before = sum(each.time <= killed_at for each in seen)
    numbers = [number_of(each) for each in found]
    said = subprocess.run(
        [sys.executable, "-m", "riot_bus", "info", str(path), "--format=json"],
        capture_output=True,
        text=True,
        check=False,
    )
    info = json.loads(said.stdout)["count"]
    gap = numbers != list(range(numbers[0], numbers[0] + len(numbers))) if numbers else False
    begin = numbers[0] - number_of(seen[0]) if numbers else 0
    expected = [each.payload for each in seen[max(0, begin) : max(0, begin) + len(found)]]
    differs = begin < 0 or [each.payload for each in found] != expected
    lost = (killed_at - (found[-1].time if found else seen[0].time)) / 1e9
    rate = (number_of(seen[-1]) - number_of(seen[0])) * 1e9 / (seen[-1].time - seen[0].time + 1)
    return Killed(after, rate, before, len(found), info, gap, differs, lost, unfinished)


def number_of(message: Message) -> int:
    return int.from_bytes(message.payload[:8], "little")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="write all figures there")
    parser.add_argument("--times", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    draw = random.Random(options.seed)
    endpoint = free_endpoint()
    results = []
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        pool = folder / "payloads"
        pool.mkdir()
        (pool / "0").write_bytes(bytes(56))
        words = [sys.executable, str(ENDS), "router", endpoint]
        router = stack.enter_context(subprocess.Popen(words, stdout=subprocess.PIPE, text=True))
        stack.callback(router.kill)
        assert router.stdout is not None
        assert router.stdout.readline()
        for number in range(options.times):
            results.append(kill_once(endpoint, folder, pool, draw.uniform(0.05, 5.0)))
            print(number, results[-1], file=sys.stderr)
    held = sum(each.holds for each in results)
    if options.json:
        options.json.write_text(json.dumps([{**asdict(each), "holds": each.holds} for each in results], indent=2))
    print(f"{'kills':>8}{'held':>8}{'msg/s':>10}{'messages':>12}{'lost, median':>14}{'lost, most':>12}")
    rate = statistics.median(each.rate for each in results)
    lost = [each.lost_s for each in results]
    total = sum(each.in_file for each in results)
    print(f"{len(results):>8}{held:>8}{rate:>10,.0f}{total:>12,}{statistics.median(lost):>12.2f} s{max(lost):>10.2f} s")
    sys.exit(0 if held == len(results) else 1)


if __name__ == "__main__":
    main()
