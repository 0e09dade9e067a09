"""Runs in the time of the log are the same each time, whatever the machine does: real processes on a real bus."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from riot_bus.log.reader import read_log
from riot_bus.pool.local import Pool
from riot_bus.system.system_file import RunPace
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict
from tests.tiers import scaled

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

NODE = """
import json, os, sys, threading
import zenoh

KIND, ENDPOINT = sys.argv[1:]
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([ENDPOINT]))
session = zenoh.open(config)
known, due = [], 0


def work(sample):
    for _ in range(1000 * os.urandom(1)[0]):  # sometimes long, sometimes not
        pass
    session.put(KIND, sample.payload.to_bytes())


def join(sample):
    known.append(f"{sample.key_expr}{sample.payload.to_string()}")
    if str(sample.key_expr) == "in":
        session.put("joined", json.dumps({"known": known[-12:]}))


def tick(sample):
    global due
    now = json.loads(sample.payload.to_string())
    now = now["sec"] * 1000 + now["nanosec"] // 1000000
    due = due or now
    while now >= due:
        session.put("tick", json.dumps({"at": due}))
        due += 35


if KIND == "timer":
    subscriber = session.declare_subscriber("clock", tick)
elif KIND == "join":
    subscribers = [session.declare_subscriber(key, join) for key in ("in", "left", "right", "tick")]
else:
    subscriber = session.declare_subscriber("in", work)
threading.Event().wait()
"""
SYSTEM = """
[system]
name = "race"
clock = { topic = "clock", step = 0.02 }

[external]
topics = ["in"]
""" + "".join(
    f"""
[components.{name}]
command = ["{{python}}", "node.py", "{name}", "{{endpoint}}"]
inputs = {inputs}
ready = {{ timeout = 60 }}
"""
    for name, inputs in (
        ("left", ["in"]),
        ("right", ["in"]),
        ("join", ["in", "left", "right", "tick"]),
        ("timer", ["clock"]),
    )
)
START, COUNT, STEP = 1_700_000_000 * 10**9, 12, 50_000_000
LOG = tuple(Message(START + number * STEP, "in", str(number).encode()) for number in range(COUNT))


def run(folder: Path, times: int) -> tuple[list[Outcome], list[list[tuple[int, str, bytes]]]]:
    """Return what comes of runs, and what was on the bus in each: time, key and payload."""
    path = folder / "riot.toml"
    path.write_text(SYSTEM)
    (folder / "node.py").write_text(NODE)
    trial = SystemTrial(RunPace(duration=1.0), ("joined:known[0]",), record=True)
    logs, outcomes = [folder / f"{number}.mcap" for number in range(times)], []
    with Pool(path, 1, keep=folder / "trials") as pool:
        outcomes = [pool.execute(trial, TestCase(LOG, seed=seed), into=log) for seed, log in enumerate(logs)]
    return outcomes, [[(one.time, one.key, one.payload) for one in read_log(log)] for log in logs]


def test_a_run_is_the_same_each_time_though_components_race(tmp_path: Path) -> None:
    outcomes, logs = run(tmp_path, scaled(20, gate=4))
    assert {one.verdict for one in outcomes} == {Verdict.PASS}
    first = logs[0]
    assert all(log == first for log in logs)
    assert [key for _, key, _ in first].count("joined") == COUNT
    ticks = [(time, json.loads(payload)["at"]) for time, key, payload in first if key == "tick"]
    assert [at for _, at in ticks] == [START // 10**6 + 35 * number for number in range(len(ticks))]
    assert len(ticks) == 1 + (COUNT - 1) * STEP // 35_000_000
    assert all(0 <= time // 10**6 - at < 20 for time, at in ticks), "each within a step of its time"
    assert [time for time, key, _ in first if key == "in"] == [message.time for message in LOG]


def run_one(folder: Path, system: str, node: str) -> Outcome:
    (folder / "riot.toml").write_text(system)
    (folder / "node.py").write_text(node)
    with Pool(folder / "riot.toml", 1, keep=folder / "trials") as pool:
        return pool.execute(SystemTrial(RunPace(duration=1.0), ("heard:attachment", "heard:now")), TestCase(LOG))


@pytest.mark.parametrize(
    ("topic", "words"),
    [("clok", "no component has subscribed to 'clok'"), ("*/x", "'*/x' does not stand for a single key")],
)
def test_a_clock_that_nobody_hears_is_told(tmp_path: Path, topic: str, words: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(words)):
        run_one(tmp_path, SYSTEM.replace('topic = "clock"', f'topic = "{topic}"'), NODE)


HEARS = """
[system]
name = "hears"
adapters = ["ros2"]
clock = { topic = "/clock" }

[external]
topics = ["in"]

[components.node]
command = ["{python}", "node.py", "{endpoint}"]
ready = { timeout = 60 }
"""
NODE_OF_ROS = """
import json, struct, sys, threading
import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)


def hear(sample):
    seconds, nanoseconds = struct.unpack_from("<iI", sample.payload.to_bytes(), 4)
    told = {"attachment": len(sample.attachment.to_bytes()), "now": seconds * 10**9 + nanoseconds}
    session.put("heard", json.dumps(told))


subscriber = session.declare_subscriber("0/clock/rosgraph_msgs::msg::dds_::Clock_/*", hear)
threading.Event().wait()
"""


def test_nodes_of_ros_2_are_told_the_time_as_rmw_zenoh_tells_it(tmp_path: Path) -> None:
    """It takes nothing without an attachment of 33 bytes."""
    heard = run_one(tmp_path, HEARS, NODE_OF_ROS).observed
    assert set(heard["heard:attachment"].values) == {33}
    times = list(heard["heard:now"].values)
    assert times == [START + number * 10_000_000 for number in range(len(times))]
    assert times[-1] == LOG[-1].time


@pytest.mark.nightly
def test_a_component_that_never_rests_is_named(tmp_path: Path) -> None:
    """Nothing of such a run could be told, so it has not passed."""
    restless = NODE.replace("threading.Event().wait()", "while True:\n    threading.Event().wait(0.0005)")
    outcome = run_one(tmp_path, SYSTEM, restless)
    assert outcome.verdict is Verdict.ERROR
    assert "is not at rest after 10 s" in outcome.detail
