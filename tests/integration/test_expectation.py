"""`riot play --expect`: a component answers what is played, and its answers are compared with those expected."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from riot_bus.control.terminal import Foreground
from riot_bus.log.reader import read_log
from riot_bus.play.options import Expectation, PlayOptions
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.comparison.compare import Wishes
from riot_bus_logtools.comparison.expectation import play_expecting
from tests.integration.play_tools import BEGIN, MS, numbered, write
from tests.integration.router_process import riot
from tests.integration.zenoh_process import ZenohProcess

pytestmark = pytest.mark.integration

COUNT = 100
COMPONENT = """
import json, sys, zenoh
endpoint, factor, silent_at = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([endpoint]))
config.insert_json5("scouting/multicast/enabled", "false")
session = zenoh.open(config)
answers = session.declare_publisher("answer", congestion_control=zenoh.CongestionControl.BLOCK)

def answer(sample):
    value = json.loads(sample.payload.to_bytes())["v"]
    if value != silent_at:
        answers.put(json.dumps({"v": value * factor, "stamp": value}), encoding="application/json")

session.declare_subscriber("question", answer)
print("ready", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def router() -> Iterator[str]:
    with ZenohProcess("router") as process:
        yield process.locators[0]


@contextmanager
def component(router: str, *, factor: float = 2.0, silent_at: int = -1) -> Iterator[None]:
    """A component that multiplies what it is asked, and perhaps once says nothing."""
    process = subprocess.Popen(
        [sys.executable, "-c", COMPONENT, router, str(factor), str(silent_at)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield
    finally:
        process.kill()
        process.communicate(timeout=60)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """What was recorded: questions, and answers to them."""
    questions = numbered(COUNT, "question", period=2 * MS)
    answers = [
        Message(
            BEGIN + number * 2 * MS + MS,
            "answer",
            json.dumps({"v": number * 2.0, "stamp": number}).encode(),
            encoding="application/json",
        )
        for number in range(COUNT)
    ]
    return write(tmp_path / "log.mcap", sorted(questions + answers, key=lambda each: each.time))


def play(log: Path, router: str, *words: object) -> tuple[int, str, str]:
    return riot(
        "play", str(log), "-e", router, "--wait=20", "--topics=question", "--expect", str(log), *map(str, words)
    )


def test_the_answers_are_as_expected(router: str, log: Path, tmp_path: Path) -> None:
    with component(router):
        code, out, err = play(log, router, "--answers", tmp_path / "answers.mcap")
    assert (code, err) == (0, "answers are expected on answer\n")
    assert f"{log} and {tmp_path}/answers.mcap are the same: {COUNT} messages of 1 topic" in out
    kept = read_log(tmp_path / "answers.mcap")
    assert [json.loads(message.payload)["v"] for message in kept] == [2.0 * number for number in range(COUNT)]


def test_one_is_lost_and_all_others_are_a_little_larger(router: str, log: Path, tmp_path: Path) -> None:
    with component(router, factor=2.001, silent_at=70):
        code, out, _ = play(log, router, "--expect-wait=20", "--format=json", "--html", tmp_path / "page.html")
        document: dict[str, Any] = json.loads(out.splitlines()[-1])
        assert (code, document["event"], document["same"]) == (1, "compared", False)
        (topic,) = document["topics"]
        assert (topic["lost_at"], topic["changed"], topic["fields"][0]["name"]) == ([70], COUNT - 2, "v")
        assert "<dt>lost</dt><dd>#70</dd>" in (tmp_path / "page.html").read_text(encoding="utf-8")
        tolerated = ("--tolerance=answer:v=0.2", "--tolerance=answer=1")
        code, out, _ = play(log, router, *tolerated)
    assert code == 0, out


def test_nobody_answers(router: str, log: Path) -> None:
    with component(router, silent_at=-1):  # asks are heard, but on another key there is no answer
        other = write(log.parent / "other.mcap", [*numbered(3, "question"), *numbered(3, "elsewhere")])
        code, out, _ = riot(
            "play", str(log), "-e", router, "--topics=question", "--expect", str(other), "--expect-wait=0.2"
        )
    assert code == 1
    assert "! elsewhere  0 of 3 -> 0 equal, 3 lost" in out.splitlines()


def test_what_is_expected_has_to_be_something_else_than_what_is_played(router: str, log: Path, tmp_path: Path) -> None:
    options = PlayOptions(logs=[log], endpoint=router, wait=0.0, control=False)
    for expectation, problem in (
        (Expectation(expect=log), "none of the compared topics can hold answers"),
        (Expectation(expect=log, expect_topics=["question"]), "none of the compared topics can hold answers"),
        (Expectation(expect=log, expect_topics=["none"]), "no log has a topic"),
        (Expectation(expect=tmp_path / "none.mcap"), "cannot read"),
    ):
        with pytest.raises(ConfigError, match=problem):
            play_expecting(options, expectation, Foreground(print, print), wishes=Wishes())
    code, _, err = riot("play", str(log), "-e", router, "--answers=x.mcap")
    assert (code, "--answers cannot be used without --expect" in err) == (2, True)


def test_without_a_router(log: Path) -> None:
    options = PlayOptions(logs=[log], endpoint="tcp/127.0.0.1:1", topics=["question"])
    with pytest.raises(EnvironmentFaultError):
        play_expecting(options, Expectation(expect=log), Foreground(print, print), wishes=Wishes())
