"""A unit that calls a service gets recorded answers when it is tested alone: real processes on a real bus."""

from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.log.writer import LogWriter
from riot_bus.sut.local import Pool
from riot_bus.sut.unit_trial import IdleTrial, UnitTrial
from riot_bus.types.serve import Request
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import TestCase, Verdict

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

NODE = """
import json, sys, threading
import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)


def ask(text):
    return [reply.ok.payload.to_string() if reply.ok else "error " + reply.err.payload.to_string()
            for reply in session.get("map/size", payload=text, timeout=20)]


(size,) = ask("at start")  # it does not begin without


def scale(sample):
    answers = ask(sample.payload.to_string())
    session.put("out", json.dumps({"size": int(size), "answers": answers}))


subscriber = session.declare_subscriber("in", scale)
threading.Event().wait()
"""
SYSTEM = """
[system]
nominal = "nominal.mcap"

[components.scaler]
command = ["{python}", "node.py", "{endpoint}"]
inputs = ["in"]
outputs = ["out"]
calls = ["map/size"]
ready = { timeout = 60 }

[unit.scaler]

[[monitors]]
kind = "never"
when = "out where answers[0] == 'error no map'"
"""
LOG = [
    Request(1, "map/size/@request", b"at start", sequence=1),
    Message(2, "map/size/@reply", b"40", sequence=1),
    Message(3, "in", b"one"),
    Request(4, "map/size/@request", b"one", sequence=2),
    Message(5, "map/size/@reply", b"41", sequence=2),
    Message(6, "in", b"two"),
    Request(7, "map/size/@request", b"two", sequence=3),
    Message(8, "map/size/@error", b"no map", sequence=3),
]


def write(folder: Path, system: str = SYSTEM, log: list[Message] = LOG) -> Path:
    (folder / "node.py").write_text(NODE)
    (folder / "riot.toml").write_text(system)
    with LogWriter(folder / "nominal.mcap") as writer:
        for message in log:
            writer.write(message)
    return folder / "riot.toml"


def test_recorded_answers_reach_a_unit_that_is_alone(tmp_path: Path) -> None:
    one, two = (message for message in LOG if message.key == "in")
    with Pool(write(tmp_path), 1, keep=tmp_path / "trials") as pool:
        assert pool.execute(IdleTrial("scaler"), TestCase()).verdict is Verdict.PASS
        passes = pool.execute(UnitTrial("scaler"), TestCase((one,)))
        fails = pool.execute(UnitTrial("scaler"), TestCase((one, two)))
    assert (passes.verdict, passes.statistics["outputs"]) == (Verdict.PASS, 1)
    assert fails.verdict is Verdict.FAIL
    assert fails.statistics["outputs"] == 2


@pytest.mark.parametrize(
    ("system", "log", "words"),
    [
        (SYSTEM.replace("map/size", "map/sise"), LOG, "no call of 'map/sise'"),
        (SYSTEM, LOG[2:3], "no call of 'map/size' with a reply"),
        (SYSTEM.replace('nominal = "nominal.mcap"', ""), LOG, "no log is named"),
    ],
)
def test_a_log_without_such_calls_is_told(tmp_path: Path, system: str, log: list[Message], words: str) -> None:
    with (
        Pool(write(tmp_path, system, log), 1, keep=tmp_path / "trials") as pool,
        pytest.raises(ConfigError, match=words),
    ):
        pool.execute(UnitTrial("scaler"), TestCase())
