"""`riot fleet index|list|show|run`, as people use them; the software under test is the press's drive."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import Writer

from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.session import wait_until
from riot_bus_fleet.logs.catalogue import Catalogue
from riot_bus_fleet.logs.query import Query
from tests.integration.agent_tools import Process
from tests.integration.play_tools import BEGIN, MS, write
from tests.integration.router_process import ENVIRONMENT, RIOT

pytestmark = pytest.mark.integration

PRESS = Path(__file__).resolve().parents[1] / "systems" / "press"
COMMANDS = "press/drive/command"
PLAN = f'[[inject]]\ntopic = "{COMMANDS}"\nfield = "speed"\nvalue = -1.5\nfirst = 3\nlast = 5\n'


def log(path: Path, mode: str, key: str = COMMANDS, count: int = 20) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    command = {"mode": mode, "speed": 12.5, "note": "x", "limits": [5, 9]}
    return write(
        path,
        [
            Message(BEGIN + number * MS, key, json.dumps({"seq": number, **command}).encode(), sequence=number)
            for number in range(count)
        ],
    )


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """A folder with logs of three robots, a plan that makes the drive hang in mode "step", and the press."""
    log(tmp_path / "logs" / "r1" / "step.mcap", "step")
    log(tmp_path / "logs" / "r1" / "hold.mcap", "hold")
    log(tmp_path / "logs" / "r2" / "other.mcap", "hold", "else/where")
    log(tmp_path / "logs" / "r2" / "short.mcap", "step", count=2)
    damaged = log(tmp_path / "logs" / "r3" / "damaged.mcap", "step")
    damaged.write_bytes(damaged.read_bytes()[:-50])
    (tmp_path / "logs" / "r3" / "text.mcap").write_text("no log")
    with (tmp_path / "logs" / "r2" / "bag.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="rosbag2")
        channel = writer.register_channel(f"/{COMMANDS}", "json", 0)
        for number in range(20):
            payload = {"seq": number, "mode": "step", "speed": 12.5, "note": "x", "limits": [5, 9]}
            writer.add_message(channel, BEGIN + number * MS, json.dumps(payload).encode(), BEGIN + number * MS)
        writer.finish()  # type: ignore[no-untyped-call]
    (tmp_path / "plan.toml").write_text(PLAN)
    shutil.copytree(PRESS, tmp_path / "press")
    return tmp_path


def fleet(work: Path, *arguments: str, code: int = 0) -> Any:
    done = subprocess.run(
        [*RIOT, "fleet", *arguments, "--format=json"],
        capture_output=True, text=True, timeout=120, check=False, cwd=work,
        env={**ENVIRONMENT, "RIOT_CATALOGUE": str(work / "c.sqlite")},
    )  # fmt: skip
    assert done.returncode == code, (done.returncode, done.stdout, done.stderr)
    return json.loads(done.stdout) if done.stdout else done.stderr


def over(work: Path, query: str, *arguments: str, code: int = 0) -> dict[str, dict[str, Any]]:
    found = fleet(
        work, "run", "plan.toml", f"--over={query}", "--system=press/riot.toml", "--unit=drive", *arguments, code=code
    )
    return {Path(each["place"]).stem: each for each in found["logs"]}


def test_logs_are_indexed_listed_and_shown(work: Path) -> None:
    assert "there is no catalogue yet" in fleet(work, "list", code=2)
    report = fleet(work, "index", "logs")
    assert (report["logs"], report["fresh"], report["damaged"], report["failures"]) == (7, 7, 2, [])
    assert fleet(work, "index", "logs")["fresh"] == 0
    names = [Path(each["place"]).name for each in fleet(work, "list", "robot=r1", "lossless")["logs"]]
    assert names == ["hold.mcap", "step.mcap"]
    found = fleet(work, "show", "step.mcap")
    assert (found["robot"], found["messages"], found["topics"][0]["topic"]) == ("r1", 20, COMMANDS)
    assert [each["problem"] for each in fleet(work, "list", "path=*text.mcap")["logs"]] == ["not an MCAP file"]
    shutil.rmtree(work / "logs" / "r1")
    assert fleet(work, "index", "logs", "--prune")["pruned"] == 2
    assert len(fleet(work, "list")["logs"]) == 5
    assert "did you mean 'robot'" in fleet(work, "list", "robt=r1", code=2)


def test_a_test_case_over_a_fleet(work: Path) -> None:
    fleet(work, "index", "logs")
    found = over(work, "", "--jobs=2", code=1)
    answers = {name: each["answer"] for name, each in found.items()}
    assert answers == {
        "step": "failed", "hold": "fixed", "damaged": "failed", "short": "error", "other": "error", "text": "error",
        "bag": "failed",
    }  # fmt: skip
    assert (found["step"]["failed"], found["step"]["trials"], found["step"]["injected"]) == (1, 1, 3)
    assert "changes nothing in it" in found["short"]["detail"]
    assert "holds nothing on the inputs of 'drive'" in found["other"]["detail"]
    assert "the log is damaged" in found["damaged"]["detail"]
    assert found["bag"]["injected"] == 3
    assert over(work, "path='*/short.mcap'", "--anywhere", code=1)["short"]["injected"] == 2
    over(work, "robot=r1 path='*/hold.mcap'")
    over(work, "path='*/other.mcap'", code=4)
    assert "no log matches" in fleet(work, "run", "plan.toml", "--over=robot=r9", "--system=press/riot.toml", code=2)


def test_mended_software_passes_and_known_answers_are_kept(work: Path) -> None:
    fleet(work, "index", "logs")
    over(work, "robot=r1", code=1)
    stored = (work / "riot-out" / "fleet" / "answers.jsonl").read_text().splitlines()
    assert len(stored) == 2
    over(work, "robot=r1", code=1)
    assert (work / "riot-out" / "fleet" / "answers.jsonl").read_text().splitlines() == stored
    drive = work / "press" / "drive.py"
    drive.write_text(drive.read_text().replace("position += int(speed)", "position += max(1, int(speed))"))
    assert {each["answer"] for each in over(work, "robot=r1").values()} == {"fixed"}


def test_an_interrupted_run_goes_on(work: Path) -> None:
    for number in range(12):
        log(work / "logs" / "many" / f"{number}.mcap", "step", count=20 + number)
    fleet(work, "index", "logs")
    answers = work / "riot-out" / "fleet" / "answers.jsonl"
    arguments = ["--over=robot=many", "--system=press/riot.toml", "--unit=drive", "--jobs=2"]
    environment = {**ENVIRONMENT, "RIOT_CATALOGUE": str(work / "c.sqlite")}
    with subprocess.Popen(
        [*RIOT, "fleet", "run", "plan.toml", *arguments], cwd=work, env=environment, stdout=subprocess.DEVNULL
    ) as process:
        assert wait_until(lambda: answers.is_file() and len(answers.read_text().splitlines()) >= 2, 60, interval=0.05)
        process.send_signal(signal.SIGKILL)
    before = len(answers.read_text().splitlines())
    assert 2 <= before < 12
    found = fleet(work, "run", "plan.toml", *arguments, code=1)["logs"]
    assert [each["answer"] for each in found] == ["failed"] * 12
    lines = [json.loads(line) for line in answers.read_text().splitlines() if line.endswith("}}")]
    assert len({each["key"] for each in lines}) == 12


def test_an_interrupted_index_goes_on(work: Path) -> None:
    source = (work / "logs" / "r1" / "step.mcap").read_bytes()
    for number in range(2000):
        (work / "logs" / f"{number}.mcap").write_bytes(source)
    with Process("fleet", "index", str(work / "logs"), f"--catalogue={work / 'c.sqlite'}") as process:
        assert wait_until((work / "c.sqlite").is_file, 60)
        with Catalogue(work / "c.sqlite") as known:
            assert wait_until(lambda: known.count(Query()) >= 20, 60, interval=0.01)
            process.process.kill()
            process.end()
            before = known.count(Query())
    report = fleet(work, "index", "logs")
    assert (report["logs"], report["fresh"]) == (2007, 2007 - before)
