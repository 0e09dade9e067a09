"""The hook, in processes that start others in the ways that programs do; that of `riot ros-test` has its own tests."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from riot_bus.processes.placement import HOOK, only_some
from riot_bus.processes.placement_hook.sitecustomize import names_of, words_of


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (["/opt/ros/lib/nav/planner"], {"planner"}),
        (["/usr/bin/python3", "-u", "-W", "error", "/ws/talker.py", "x"], {"python3", "talker.py", "talker"}),
        (["python3.12", "-m", "nav.planner"], {"python3.12", "nav.planner"}),
        (["python3", "-c", "planner"], {"python3"}),
        (["python3"], {"python3"}),
        (["./planner.py"], {"planner.py", "planner"}),
        (
            ["gdb", "--args", "exe", "--ros-args", "-r", "__node:=planner", "-r", "__ns:=/robot1"],
            {"gdb", "planner", "/robot1/planner"},
        ),
        (["exe", "--ros-args", "--remap", "old:__node:=planner"], {"exe", "planner", "/planner"}),
    ],
)
def test_names_of_a_process(words: list[str], names: set[str]) -> None:
    assert set(names_of(words)) == names


def test_words_of_what_popen_takes() -> None:
    assert words_of(["a", b"b", Path("c")]) == ["a", "b", "c"]
    assert words_of("planner x") == ["planner x"]
    assert words_of("planner 'x y'", shell=True) == ["planner", "x y"]
    assert words_of("planner it's", shell=True) == ["planner", "it's"]


def test_without_riot_it_does_nothing(tmp_path: Path) -> None:
    code = "import subprocess; print(subprocess.Popen.__init__.__qualname__)"
    for file in (None, tmp_path / "gone.json"):
        environment = {"PYTHONPATH": str(HOOK), **({"RIOT_PLACEMENT": str(file)} if file else {})}
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
        assert (done.stdout, done.stderr) == ("Popen.__init__\n", "")


LAUNCHES = """
import asyncio, subprocess, sys, time

async def main():
    started = [await asyncio.create_subprocess_exec(sys.executable, *words.split()) for words in sys.argv[1:]]
    written = subprocess.run([sys.executable, "-c", "print('written')"], capture_output=True, text=True).stdout
    print(written, end="", flush=True)
    print(await started[0].wait(), started[1].returncode, flush=True)
    started[1].kill()
    await started[1].wait()

asyncio.run(main())
"""


def test_what_is_not_chosen_is_not_started_and_whoever_started_it_goes_on(tmp_path: Path) -> None:
    part = "import os, subprocess, sys; open(sys.argv[0] + '.out', 'w').write(str('RIOT_PLACEMENT' in os.environ))\n"
    part += "subprocess.Popen(['touch', 'by-' + os.path.basename(sys.argv[0])]).wait()"
    for name in ("planner.py", "driver.py"):
        (tmp_path / name).write_text(part)
    given = {"PATH": os.environ["PATH"]}
    environment = {**given, **only_some(given, "plan.*", plan=tmp_path / "some")}
    done = subprocess.run(
        [sys.executable, "-c", LAUNCHES, "planner.py", "driver.py"],
        capture_output=True,
        text=True,
        env=environment,
        cwd=tmp_path,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "written\n0 None\n"
    assert (tmp_path / "planner.py.out").read_text() == "False"
    assert (tmp_path / "by-planner.py").exists()  # what a chosen one starts is its own affair
    assert not (tmp_path / "driver.py.out").exists()
    told = [json.loads(line)["names"][-1] for line in (tmp_path / "some.started").read_text().splitlines()]
    assert told == ["planner", "driver"]
