from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from riot_bus.processes.python_report import MainEnd, PythonReport
from riot_bus.zenoh.session import wait_until

RECURSES = """
import threading

def search(depth):
    return max(search(depth - 1) for _ in range(3)) if depth else 0

def spin():
    while True:
        search(300)

threading.Thread(target=spin, daemon=True).start()
print("started", flush=True)
threading.Event().wait()
"""
PROGRAM = """
import os, sys, threading

def waits():
    threading.Event().wait()

def worker():
    waits()

def leave():
    {end}

threading.Thread(target=worker).start()
print("started", flush=True)
leave()
"""


def start(tmp_path: Path, end: str, **environment: str) -> tuple[subprocess.Popen[str], PythonReport]:
    return begin(tmp_path, PROGRAM.format(end=end), **environment)


def begin(tmp_path: Path, text: str, **environment: str) -> tuple[subprocess.Popen[str], PythonReport]:
    program = tmp_path / "unit.py"
    program.write_text(text)
    report = PythonReport(tmp_path)
    given = {**os.environ, **environment}
    process = subprocess.Popen(
        [sys.executable, str(program)], env={**given, **report.environment(given)}, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "started\n"
    return process, report


def test_the_end_of_the_main_thread_is_told_though_the_process_goes_on(tmp_path: Path) -> None:
    process, report = start(tmp_path, "sys.exit(3)")
    try:
        assert wait_until(lambda: report.main_end([process.pid]) is not None, 10)
        assert report.main_end([process.pid]) == MainEnd("sys.exit(3)", "leave")
        assert process.poll() is None
        assert (tmp_path / "python.events").stat().st_mode & 0o777 == 0o600
        assert [stack.functions for stack in report.stacks([process.pid])] == [("waits", "worker")]
    finally:
        process.kill()
        process.communicate()


def test_a_main_thread_that_goes_on_has_not_ended(tmp_path: Path) -> None:
    process, report = start(tmp_path, "waits()")
    try:
        assert wait_until(
            lambda: {stack.functions[0] for stack in report.stacks([process.pid])} == {"waits"}, 10, interval=0.05
        )
        assert {stack.functions[-1] for stack in report.stacks([process.pid])} == {"worker", "<module>"}
        assert report.main_end([process.pid]) is None
        assert report.exit_call([process.pid]) is None
    finally:
        process.kill()
        process.communicate()


def test_a_look_at_a_thread_that_recurses_does_not_end_the_process(tmp_path: Path) -> None:
    process, report = begin(tmp_path, RECURSES)
    try:
        for _ in range(100):
            assert {stack.functions[0] for stack in report.stacks([process.pid])} & {"search", "<genexpr>"}
        assert process.poll() is None
    finally:
        process.kill()
        process.communicate()


def test_a_component_that_closes_all_files_does_not_see_that_it_is_looked_at(tmp_path: Path) -> None:
    text = RECURSES.replace("threading.Event().wait()", "import os, time; os.closerange(3, 200); time.sleep(600)")
    process, report = begin(tmp_path, text)
    try:
        for _ in range(3):
            report.stacks([process.pid])
        assert process.poll() is None
    finally:
        process.kill()
        process.communicate()


def test_who_ended_the_process_is_told(tmp_path: Path) -> None:
    process, report = start(tmp_path, "os._exit(0)")
    process.communicate(timeout=10)
    assert report.exit_call([process.pid]) == MainEnd("os._exit(0)", "leave")


def test_a_sitecustomize_of_ones_own_is_imported_as_ever(tmp_path: Path) -> None:
    own = tmp_path / "own"
    own.mkdir()
    (own / "sitecustomize.py").write_text(f"open({str(tmp_path / 'was here')!r}, 'w').close()\n")
    process, _ = start(tmp_path, "os._exit(0)", PYTHONPATH=str(own))
    process.communicate(timeout=10)
    assert (tmp_path / "was here").exists()


def test_a_component_sees_nothing_of_a_folder_that_is_gone(tmp_path: Path) -> None:
    (tmp_path / "unit.py").write_text("import sys\nsys.exit(3)\n")
    given = {**os.environ, **PythonReport(tmp_path / "gone").environment(os.environ)}
    command = [sys.executable, str(tmp_path / "unit.py")]
    done = subprocess.run(command, env=given, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (3, "", "")
