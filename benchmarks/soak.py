"""Whether the router leaks or loses anything while everything happens to it for a while.

python benchmarks/soak.py [--minutes 10] [--json FILE]

`riot router` runs as a process: it intercepts, injects, asks an interceptor that raises and makes rubbish, and records
to files that are split. Components are processes too: some publish and count, some are killed and replaced again and
again, two publish more than a million keys in the course of ten minutes. The router's memory, open files and threads
are sampled. The first part of the run is warm-up: new keys come faster, so that all that is kept by key gets to its
bound; files are split more often, too, as one has room for 65,000 keys.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil
from common import machine

from riot_bus.control.remote import Remote
from riot_bus.log.reader import LogReader
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from multiprocessing.connection import Connection
    from multiprocessing.context import SpawnProcess

SAMPLE_S, SPLIT_S, KILL_S = 5.0, 30.0, 15.0
TIMEOUT_S = 60.0
WARM_UP = 0.3
"""Share of the run."""
KEYS_PER_S = {"many/cut": 500, "many/free": 1200}
"""New keys, each with one message; a million in ten minutes, not counting that more come in the warm-up."""
HASTE = 3
"""How many times as fast they come in the warm-up."""
RATES = {"cut/state": 200.0, "cut/faulty": 100.0, "free/native": 100.0, "cut/back": 100.0}
INJECTED = 99
MOST_RISE = {"rss_mib": 0.05, "fds": 0.0, "threads": 0.0}
"""By which share of its median a figure may rise from the end of the warm-up to the end; of fds and threads, by one."""
PLAN = f"""
[[inject]]
topic = "cut/state"
field = "v"
value = {INJECTED}
"""
INTERCEPTOR = """
class Faulty:
    topics = ["cut/faulty"]

    def message(self, event):
        match event.index % 100:
            case 0:
                raise RuntimeError("on purpose")
            case 1:
                event.message = event.message.with_(payload=None)
            case 2:
                event.add(event.message.with_(key="//"))
            case 3:
                event.delay(0.05)
            case 4:
                event.duplicate(2)
            case 5:
                event.drop()
"""
SPAWN = multiprocessing.get_context("spawn")
BLOCK = Qos(congestion="block")


@dataclass
class Samples:
    """What the system said of the router, over time."""

    seconds: list[float] = field(default_factory=list)
    figures: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in MOST_RISE})

    def take(self, process: psutil.Process, now: float) -> None:
        """Look once."""
        self.seconds.append(round(now, 1))
        self.figures["rss_mib"].append(round(process.memory_info().rss / 2**20, 1))
        self.figures["fds"].append(process.num_fds())
        self.figures["threads"].append(process.num_threads())

    def trend(self, name: str, begin: float) -> dict[str, Any]:
        """Return how a figure went on after `begin`: its rise is that of a straight line through all samples."""
        found = [(x, y) for x, y in zip(self.seconds, self.figures[name], strict=True) if x >= begin]
        seconds, values = [x for x, _ in found], [y for _, y in found]
        slope = statistics.linear_regression(seconds, values).slope if len(set(seconds)) > 1 else 0.0
        rise, middle = slope * (seconds[-1] - seconds[0]), statistics.median(values)
        return {
            "first": self.figures[name][0],
            "median": middle,
            "min": min(values),
            "max": max(values),
            "per_hour": round(slope * 3600, 2),
            "rise": round(rise, 2),
            "steady": rise <= max(1.0, MOST_RISE[name] * middle),
        }


# -- components -------------------------------------------------------------------------------------------------------


def publish(endpoint: str, rates: dict[str, float], seconds: float, pipe: Connection) -> None:
    """Publish numbered messages on some keys until told to stop; tell how many on each."""
    sent: Counter[str] = Counter()
    with open_client(endpoint) as client:
        began = time.monotonic()
        while not pipe.poll(0.01):
            now = min(time.monotonic() - began, seconds)
            for key, rate in rates.items():
                while sent[key] < rate * now:
                    payload = json.dumps({"n": sent[key], "v": 1}).encode()
                    client.put(Message(0, key, payload, qos=BLOCK))
                    sent[key] += 1
        pipe.send(dict(sent))
        pipe.recv()  # leaving before the receivers have all would take queued messages along


def publish_keys(endpoint: str, prefix: str, seconds: float, pipe: Connection) -> None:
    """Publish on ever new keys; tell how many."""
    import zenoh

    sent = 0
    with open_client(endpoint) as client:
        began = time.monotonic()
        while not pipe.poll(0.01):
            now = min(time.monotonic() - began, seconds)
            while sent < KEYS_PER_S[prefix] * (now + (HASTE - 1) * min(now, WARM_UP * seconds)):
                client.session.put(f"{prefix}/{sent}", b"x", congestion_control=zenoh.CongestionControl.BLOCK)
                sent += 1
        pipe.send({prefix: sent})
        pipe.recv()


def count(endpoint: str, expressions: list[str], pipe: Connection) -> None:
    """Count messages by key, and what is wrong with them; tell it whenever asked."""
    counts: Counter[str] = Counter()
    wrong: Counter[str] = Counter()
    last: dict[str, int] = {}

    def take(sample: Any) -> None:
        key = str(sample.key_expr)
        if key.startswith("many/"):
            counts[key.rpartition("/")[0]] += 1
            return
        counts[key] += 1
        if key not in RATES or key == "cut/faulty":
            return
        found = json.loads(sample.payload.to_bytes())
        wrong["order"] += found["n"] != last.get(key, -1) + 1
        wrong["value"] += found["v"] != (INJECTED if key == "cut/state" else 1)
        last[key] = found["n"]

    with open_client(endpoint) as client:
        subscribers = [client.session.declare_subscriber(each, take) for each in expressions]
        pipe.send("subscribed")
        while pipe.recv() == "tell":
            pipe.send((dict(counts), dict(wrong)))
        del subscribers


def victim(endpoint: str, pipe: Connection) -> None:
    """Publish in bursts, subscribe, and declare, until killed."""
    with open_client(endpoint) as client:
        keep = [client.session.declare_subscriber("cut/**", lambda sample: None)]
        keep.append(client.session.liveliness().declare_token(f"alive/{os.getpid()}"))
        pipe.send("here")
        while not pipe.poll(0.05):
            for number in range(50):
                client.put(Message(0, "cut/victim", number.to_bytes(8, "little"), qos=BLOCK))


@dataclass
class Child:
    """A process that we started, and our end of its pipe."""

    process: SpawnProcess
    pipe: Connection

    def receive(self) -> Any:
        """Return what it says next."""
        if not self.pipe.poll(TIMEOUT_S):
            raise TimeoutError(f"{self.process.name} says nothing for {TIMEOUT_S:g} s")
        return self.pipe.recv()

    def ask(self, what: str) -> Any:
        """Say something and return the answer."""
        self.pipe.send(what)
        return self.receive()

    def end(self) -> None:
        """Kill it."""
        self.process.kill()
        self.process.join()
        self.pipe.close()


@contextmanager
def child(target: Callable[..., None], *arguments: Any) -> Iterator[Child]:
    ours, theirs = SPAWN.Pipe()
    process = SPAWN.Process(target=target, args=(*arguments, theirs), name=target.__name__, daemon=True)
    process.start()
    theirs.close()
    one = Child(process, ours)
    try:
        yield one
    finally:
        one.end()


# -- the run ----------------------------------------------------------------------------------------------------------


class Recordings:
    """Files of the recording: each is counted and removed once it is finished."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.files = self.messages = 0

    def take(self, path: Path) -> None:
        """Count the messages of a finished file."""
        with LogReader(path) as reader:
            self.messages += sum(1 for _ in reader.messages())
            if reader.loss:
                raise ValueError(f"{path}: {reader.loss}")
        path.unlink()
        self.files += 1


@contextmanager
def running(folder: Path) -> Iterator[tuple[subprocess.Popen[str], dict[str, str]]]:
    """Run the router; return its process and endpoints by segment."""
    (folder / "plan.toml").write_text(PLAN)
    (folder / "faulty.py").write_text(INTERCEPTOR)
    segments = [f"--segment={name}=tcp/127.0.0.1:0" for name in ("system", "unit")]
    intercept = [f"--intercept={each}" for each in ("cut/**", "many/cut/**")]
    more = [f"--interceptor={folder}/faulty.py", f"--inject={folder}/plan.toml", f"--record={folder}/soak.mcap"]
    command = [sys.executable, "-m", "riot_bus", "router", *segments, *intercept, *more, "--format=json", "--name=soak"]
    with (
        (folder / "stderr.txt").open("w") as errors,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, cwd=folder) as process,
    ):
        assert process.stdout is not None
        line = process.stdout.readline()
        if not line:
            sys.exit(f"the router does not start:\n{(folder / 'stderr.txt').read_text()}")
        try:
            yield process, {name: found[0] for name, found in json.loads(line)["endpoints"].items()}
        except Exception:
            print((folder / "stderr.txt").read_text(), file=sys.stderr)
            raise
        finally:
            process.kill()


def soak(folder: Path, seconds: float) -> dict[str, Any]:
    samples, recordings, kills = Samples(), Recordings(folder), 0
    with ExitStack() as stack:
        router, ends = stack.enter_context(running(folder))
        usage = psutil.Process(router.pid)
        sinks = {
            "unit": stack.enter_context(child(count, ends["unit"], ["cut/**", "many/**", "free/**"])),
            "system": stack.enter_context(child(count, ends["system"], ["cut/back"])),
        }
        for each in sinks.values():
            each.receive()
        remote = stack.enter_context(Remote(ends["unit"], "soak"))
        wait_until(lambda: False, 1.0)  # until routes are up
        forth = {key: rate for key, rate in RATES.items() if key != "cut/back"}
        sources = [
            stack.enter_context(child(publish, ends["system"], forth, seconds)),
            stack.enter_context(child(publish, ends["unit"], {"cut/back": RATES["cut/back"]}, seconds)),
            *(stack.enter_context(child(publish_keys, ends["system"], prefix, seconds)) for prefix in KEYS_PER_S),
        ]
        began = time.monotonic()
        victims = stack.enter_context(ExitStack())
        sampled, split, killed = 0.0, SPLIT_S / HASTE, 0.0
        while (now := time.monotonic() - began) < seconds:
            if now >= sampled:
                samples.take(usage, now)
                sampled += SAMPLE_S
                _say(samples, seconds)
            if now >= split:
                recordings.take(Path(remote.ask("record/split")["former"]))
                split += SPLIT_S / HASTE if now < WARM_UP * seconds else SPLIT_S
            if now >= killed:
                victims.close()  # kill -9
                for segment in ("system", "unit"):
                    kills += 1
                    victims.enter_context(child(victim, ends[segment])).receive()
                killed += KILL_S
            time.sleep(0.1)
        victims.close()
        sent: Counter[str] = Counter()
        for each in sources:
            sent.update(each.ask("stop"))
        arrived = _arrived(sinks, sent)
        samples.take(usage, time.monotonic() - began)
        wrong: Counter[str] = Counter()
        for each in sinks.values():
            wrong.update(each.ask("tell")[1])
        router.send_signal(signal.SIGTERM)
        out, _ = router.communicate(timeout=TIMEOUT_S)
        recordings.take(max(folder.glob("*.mcap"), key=lambda path: path.stat().st_mtime))
    errors = (folder / "stderr.txt").read_text()
    ended = json.loads(out.splitlines()[-1])
    return _figures(samples, seconds, ended, sent, arrived, wrong) | {
        "exit_code": router.returncode,
        "kills": kills,
        "files": recordings.files,
        "messages_in_files": recordings.messages,
        "stderr": {"lines": len(errors.splitlines()), "panicked": errors.count("panicked"), "end": errors[-2000:]},
    }


def _arrived(sinks: dict[str, Child], sent: Counter[str]) -> dict[str, int]:
    """Wait until everything has arrived that was published by those who lived, as far as it ever will."""
    arrived: Counter[str] = Counter()

    def complete() -> bool:
        arrived.clear()
        for segment, each in sinks.items():
            counts = each.ask("tell")[0]
            arrived.update({key: n for key, n in counts.items() if (key == "cut/back") == (segment == "system")})
        return all(arrived[key] >= sent[key] for key in sent if key != "cut/faulty")

    wait_until(complete, TIMEOUT_S, interval=0.5)
    return {key: arrived[key] for key in sent}


def _figures(
    samples: Samples,
    seconds: float,
    ended: dict[str, Any],
    sent: Counter[str],
    arrived: dict[str, int],
    wrong: Counter[str],
) -> dict[str, Any]:
    rows = ended["counts"]
    total: Counter[str] = Counter()
    for row in rows.values():
        total.update({name: number for name, number in row.items() if name != "balanced"})
    left = total["received"] + total["added"]
    return {
        "machine": machine(),
        "minutes": round(seconds / 60, 2),
        "trends": {name: samples.trend(name, WARM_UP * seconds) for name in MOST_RISE},
        "samples": {"seconds": samples.seconds, **samples.figures},
        "sent": dict(sent),
        "arrived": arrived,
        "wrong": dict(wrong),
        "counts": dict(total),
        "topics": len(rows),
        "unbalanced": [topic for topic, row in rows.items() if not row["balanced"]],
        "balanced": left == sum(total[name] for name in ("forwarded", "dropped", "lost", "held")),
        "losses": ended["losses"],
        "interceptors": {
            each["name"]: {"errors": each["errors"], "bypassed": each["bypassed"]} for each in ended["interceptors"]
        },
    }


def _say(samples: Samples, seconds: float) -> None:
    if sys.stderr.isatty() or samples.seconds[-1] % 60 < SAMPLE_S:
        figures = ", ".join(f"{name} {found[-1]:g}" for name, found in samples.figures.items())
        end = "\r" if sys.stderr.isatty() else "\n"
        print(f"{samples.seconds[-1]:.0f} of {seconds:.0f} s: {figures:<60}", end=end, file=sys.stderr, flush=True)


# -- reporting --------------------------------------------------------------------------------------------------------


def problems(figures: dict[str, Any]) -> list[str]:
    """Return what must never happen."""
    found = [
        f"{name} rises by {each['rise']:g} after the warm-up"
        for name, each in figures["trends"].items()
        if not each["steady"]
    ]
    if figures["unbalanced"] or not figures["balanced"]:
        found.append(f"counts do not balance: {figures['unbalanced'][:5] or 'altogether'}")
    for key, number in figures["sent"].items():
        if key != "cut/faulty" and figures["arrived"][key] != number:
            found.append(f"{key}: {number} sent, {figures['arrived'][key]} arrived")
    counts = figures["counts"]
    found += [f"{number} messages with a wrong {what}" for what, number in figures["wrong"].items() if number]
    if counts["lost"] or figures["losses"]["links"]:
        found.append(f"losses: {figures['losses']}")
    if counts["recorded"] != figures["messages_in_files"]:
        found.append(f"{counts['recorded']} messages recorded, {figures['messages_in_files']} in the files")
    expected = 3 if counts["lost"] or counts["unrecorded"] or figures["losses"]["links"] else 0
    if figures["exit_code"] != expected:
        found.append(f"the router ended with {figures['exit_code']}, not {expected}")
    if figures["stderr"]["panicked"]:
        found.append(f"panicked: {figures['stderr']['panicked']} times")
    if not figures["interceptors"]["Faulty"]["errors"]:
        found.append("the interceptor never raised")
    found += [
        f"interceptor {name}: {each['bypassed']}" for name, each in figures["interceptors"].items() if each["bypassed"]
    ]
    return found


def show(figures: dict[str, Any]) -> None:
    counts = figures["counts"]
    print(
        f"{figures['minutes']:g} minutes, the first {WARM_UP:.0%} of them warm-up; {figures['kills']} components killed"
    )
    print(f"\n  {'of the router':<14}{'start':>9}{'median':>9}{'min':>9}{'max':>9}{'per hour':>10}{'rise':>8}")
    for name, each in figures["trends"].items():
        values = "".join(f"{each[column]:>9g}" for column in ("first", "median", "min", "max"))
        verdict = "about zero" if each["steady"] else "RISES"
        print(f"  {name:<14}{values}{each['per_hour']:>10g}{each['rise']:>8g}  {verdict}")
    print(f"\n  {'key':<14}{'sent':>10}{'arrived':>10}")
    for key, number in figures["sent"].items():
        print(f"  {key:<14}{number:>10,}{figures['arrived'][key]:>10,}")
    print("\n  " + ", ".join(f"{name} {number:,}" for name, number in counts.items()))
    balance = "balance" if figures["balanced"] and not figures["unbalanced"] else "DO NOT BALANCE"
    print(f"  counts of {figures['topics']} topics {balance}: received + added = forwarded + dropped + lost + held")
    print(f"  {figures['messages_in_files']:,} messages in {figures['files']} files; losses: {figures['losses']}")
    print(f"  interceptors: {figures['interceptors']}")
    print(f"  'panicked' on stderr: {figures['stderr']['panicked']} times, of {figures['stderr']['lines']} lines")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to this file, too")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="riot-soak-") as folder:
        figures = soak(Path(folder), 60 * options.minutes)
    show(figures)
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=2) + "\n")
    if found := problems(figures):
        sys.exit("\nproblems:\n  " + "\n  ".join(found))


if __name__ == "__main__":
    main()
