"""Runs of a whole system a minute, with processes that are started for each run and with processes that are reset.

Run `python benchmarks/system_reset.py [--runs N] [--start SECONDS]`. The system is one component that needs `--start`
seconds until it works, as a simulator or a stack with a map does; each run plays half a second of log to it.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from riot_bus.pool.local import Pool
from riot_bus.system.system_file import RunPace
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import TestCase, Verdict

NODE = """
import json, sys, threading, time
import zenoh

time.sleep(float(sys.argv[2]))
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)
total = 0


def reset(sample):
    global total
    total = 0


def add(sample):
    global total
    total += 1
    session.put("total", json.dumps({"total": total}))


subscribers = [session.declare_subscriber("reset", reset), session.declare_subscriber("in", add)]
threading.Event().wait()
"""
SYSTEM = """
[system]
{reset}

[external]
topics = ["in"]

[components.add]
command = ["{{python}}", "node.py", "{{endpoint}}", "{start}"]
inputs = ["in"]
outputs = ["total"]
ready = {{ timeout = 120 }}
"""
_ALL = [*range(1, 12)]
LOG = tuple(Message(10**18 + number * 50_000_000, "in", b"1") for number in range(11))


def rate(folder: Path, *, reset: str, start: float, runs: int) -> float:
    """Return runs a minute; all have to pass, each with the same outputs."""
    (folder / "node.py").write_text(NODE)
    (folder / "riot.toml").write_text(SYSTEM.format(reset=reset, start=start))
    trial = SystemTrial(RunPace(duration=0.5), ("total:total",))
    begin = time.monotonic()
    with Pool(folder / "riot.toml", 1, keep=folder / "trials") as pool:
        for number in range(runs):
            outcome = pool.execute(trial, TestCase(LOG, seed=number))
            seen = list(outcome.observed["total:total"].values)
            # The last answer may come when the run is over.
            if outcome.verdict is not Verdict.PASS or seen not in (_ALL, _ALL[:-1]):
                raise SystemExit(f"run {number} with {reset or 'fresh processes'}: {outcome.verdict}, {seen}")
    return 60 * runs / (time.monotonic() - begin)


def main() -> None:
    """Measure both and print a line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--runs", type=int, default=20, help="with processes that are reset; a quarter with fresh ones")
    parser.add_argument("--start", type=float, default=5.0, help="seconds that the component needs to start")
    options = parser.parse_args()
    rates = {}
    for name, reset, runs in (
        ("fresh", "", -(-options.runs // 4)),
        ("reset", 'reset = { topic = "reset" }', options.runs),
    ):
        with tempfile.TemporaryDirectory() as folder:
            rates[name] = rate(Path(folder), reset=reset, start=options.start, runs=runs)
    found = {f"{name}_per_minute": round(value, 1) for name, value in rates.items()}
    print(json.dumps({"start_s": options.start, **found, "times": round(rates["reset"] / rates["fresh"], 1)}))


if __name__ == "__main__":
    main()
