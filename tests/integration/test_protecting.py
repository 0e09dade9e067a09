"""What a maintainer gets for a finding, with the rover's planner as a real process: a test, a guard."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.chain.base.logs import FailingLog
from riot_bus.findings.records import FindingRecord, MinimalRecord
from riot_bus.generalize.features import Feature
from riot_bus.generalize.literals import Literal
from riot_bus.generalize.rule import Rule
from riot_bus.report.regression import write_regression_test
from riot_bus.trial.context import open_system
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.session import wait_until
from tests.integration.bus_puppet import Puppet
from tests.integration.router_process import RouterProcess

pytestmark = [pytest.mark.integration, pytest.mark.timeout(240)]

ROOT = Path(__file__).parents[2]
SIGNATURE = "crash in planner: window: return Window((ctypes.c_int8 * (update.x * update.y)).from_buffer(self._cells))"
FIX = "        if not 0 <= update.x * update.y <= WORKSPACE:\n            update.x = update.y = 0\n"


@pytest.fixture
def rover(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(ROOT / "examples/rover", tmp_path / "rover", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.syspath_prepend(str(tmp_path / "rover"))
    return tmp_path / "rover"


def update(x: int, y: int, number: int = 0) -> Message:
    from rover.maps import OccupancyGridUpdate
    from rover.topics import key

    payload = OccupancyGridUpdate((1, 2), x, y, 2, 2, bytes(4)).encode()
    return Message(10**18 + number * 10**8, key("/map_updates"), payload, sequence=number)


def write_finding(rover: Path) -> Path:
    """Write a finding of the planner as the first steps do."""
    folder = rover / "riot-out/findings/crash-planner-1"
    folder.mkdir(parents=True)
    record = FindingRecord(
        id="crash-planner-1", system="rover", system_file=str(rover / "riot.toml"), unit="planner",
        component="planner", monitor="crash", signature=SIGNATURE,
    )  # fmt: skip
    record.save(folder)
    MinimalRecord(before=9, kept=(0,), topics=("/map_updates",), one_minimal=True).save(folder)
    log = FailingLog((update(-3, 700),), {0: update(3, 700)})
    log.save(folder / "minimal.mcap", context=open_system(rover / "riot.toml"), metadata={})
    write_regression_test(folder, record)
    return folder


def pytest_says(folder: Path) -> tuple[int, str]:
    paths = os.pathsep.join(str(ROOT / name) for name in ("", "adapters", "dictionaries"))
    (file,) = folder.glob("riot_test_*.py")
    command = [sys.executable, "-m", "pytest", str(file), "-q", "-p", "no:cacheprovider", "--rootdir=."]
    done = subprocess.run(
        command,
        cwd=folder.parents[2],
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=200,
    )
    return done.returncode, done.stdout + done.stderr


def test_the_regression_test_fails_today_and_passes_when_the_planner_is_mended(rover: Path) -> None:
    folder = write_finding(rover)
    code, output = pytest_says(folder)
    assert code == 1, output
    assert "3 of 3 trials of minimal.mcap fail: crash in planner" in output
    source = rover / "rover/workspace.py"
    text = source.read_text()
    place = text.index("        return Window(")
    source.write_text(text[:place] + FIX + text[place:])
    code, output = pytest_says(folder)
    assert code == 0, output
    assert not list(folder.glob("**/trials"))


X, Y = "/map_updates:x", "/map_updates:y"


def write_rule(path: Path) -> Path:
    product = Feature("mul", (X, Y))
    rule = Rule(((Literal(product, "<", 0),), (Literal(product, ">", 4194304),)))
    path.write_text(
        json.dumps({"rule": rule.to_dict(), "types": {X: "int32", Y: "int32"}, "scale": {X: 68.0, Y: 60.0}})
    )
    return path


def nominal(seconds: int = 1) -> list[tuple[str, bytes]]:
    """Return what the planner gets in a nominal run: a map, where it is, where it goes, and many updates."""
    from rover.maps import OccupancyGrid
    from rover.messages import PoseStamped
    from rover.sensors import Odometry
    from rover.topics import key

    stamp = (seconds, 2)
    updates = [(key("/map_updates"), update(x, (seconds + 2) * x % 257).payload) for x in range(1, 200)]
    grid = OccupancyGrid(stamp, 1.0, 8, 8, 0.0, 0.0, bytes(64))
    goal, place = PoseStamped(stamp, 3.0, 4.0), Odometry(stamp, 1.0, 2.0, 0.5, 0.5)
    known = [(key("/map"), grid), (key("/odom"), place), (key("/goal"), goal)]
    return [*((name, one.encode()) for name, one in known), *updates]


def test_a_guard_keeps_the_planner_alive_and_everything_else_as_it_is(rover: Path, tmp_path: Path) -> None:
    from rover.topics import key

    topics = {name for name, _ in nominal()}
    rule, types = write_rule(tmp_path / "rule.json"), rover / "map_msgs/msg/OccupancyGridUpdate.msg"
    guard = ["--msg", str(types), "--interceptor", f"guard rule={rule} action=clamp"]
    with RouterProcess(*guard) as router:
        command = [sys.executable, "-m", "rover.planner", "--connect", router.endpoints["unit"]]
        planner = subprocess.Popen(command, cwd=rover, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        try:
            with Puppet(router.endpoints["system"]) as outside, Puppet(router.endpoints["unit"]) as inside:
                outside.do("subscribe", key="0/plan/**")
                inside.do("subscribe", key="0/**")

                def put(name: str, payload: bytes) -> None:
                    outside.do("put", key=name, payload=payload.hex(), congestion="BLOCK")

                def plans() -> int:
                    return len(outside.do("wait", count=0))

                def seen() -> dict[str, list[bytes]]:
                    """What has come to the planner's segment; order holds within a topic."""
                    found: dict[str, list[bytes]] = {name: [] for name in topics}
                    for each in inside.do("wait", count=0):
                        found.get(each["key"], []).append(bytes.fromhex(each["payload"]))
                    return found

                def planned() -> bool:
                    for name, payload in nominal()[:8]:
                        put(name, payload)
                    return plans() > 0 and all(seen().values())

                assert wait_until(planned, 60, interval=0.05)
                marks = dict(nominal(seconds=99)[:4])
                for name, payload in marks.items():
                    put(name, payload)
                assert wait_until(lambda: all(marks[name] in each for name, each in seen().items()), 60, interval=0.02)
                before, begun = plans(), {name: each.index(marks[name]) + 1 for name, each in seen().items()}
                updates = key("/map_updates")
                for name, payload in [*nominal(), (updates, update(-3, 700).payload), *nominal()]:
                    put(name, payload)
                expected = {name: [payload for each, payload in nominal() if each == name] for name in topics}
                middle = {name: [update(0, 700).payload] if name == updates else [] for name in topics}
                expected = {name: [*each, *middle[name], *each] for name, each in expected.items()}
                counts = {name: begun[name] + len(each) for name, each in expected.items()}
                assert wait_until(lambda: {n: len(each) for n, each in seen().items()} == counts, 60, interval=0.05)
                assert {name: each[begun[name] :] for name, each in seen().items()} == expected
                assert wait_until(lambda: plans() > before, 60, interval=0.05)
                assert planner.poll() is None
        finally:
            planner.kill()
            planner.communicate(timeout=60)
        code, _, errors = router.end(signal.SIGINT)
    assert code == 0, errors
    assert "clamped (/map_updates:x = -3, /map_updates:y = 700)" in errors
    assert "the rule held for 1 messages: 1 clamped" in errors
