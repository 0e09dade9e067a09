from __future__ import annotations

import os
import signal
from pathlib import Path

from riot_bus.processes.python_report import PythonReport, ThreadStack, deepest_common, parse_stacks

STACKS = """Thread 0x1 (most recent call first):
  File "/usr/lib/python3.11/threading.py", line 320 in wait
  File "/srv/unit.py", line 5 in waits
  File "/srv/unit.py", line 8 in worker
  File "/usr/lib/python3.11/threading.py", line 975 in run

Thread 0x2 (most recent call first):
  File "/srv/.venv/lib/python3.11/site-packages/zenoh/x.py", line 1 in run

Current thread 0x3 (most recent call first):
  File "/srv/unit.py", line 20 in <module>
"""


def test_threads_are_read_without_what_libraries_do() -> None:
    assert [stack.functions for stack in parse_stacks(STACKS)] == [("waits", "worker"), ("<module>",)]


def test_other_processes_and_broken_lines_say_nothing(tmp_path: Path) -> None:
    report = PythonReport(tmp_path)
    assert report.stacks([os.getpid()]) == []
    (tmp_path / "python.events").write_text('{"pid": 1, "eve\nnull\n[]\n')
    assert report.main_end([1]) is None
    assert signal.getsignal(signal.SIGRTMAX - 1) == signal.SIG_DFL


def test_a_thread_that_runs_stands_in_what_all_looks_share() -> None:
    def look(*functions: str) -> list[ThreadStack]:
        return [ThreadStack(functions, "")]

    looks = [look("inner", "spin", "main"), look("spin", "main"), look("other", "spin", "main")]
    assert [stack.functions for stack in deepest_common(looks)] == [("spin", "main")]
    assert deepest_common([look("a"), []]) == []
    assert [stack.functions for stack in deepest_common([look("a"), look("b")])] == [("b",)]
