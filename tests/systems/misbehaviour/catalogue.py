"""The kinds of `node.py` and what a test of each must find; `write` makes a system of them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message

__all__ = ["FAULTY", "ORDER", "ROBUST", "write"]

FOLDER = Path(__file__).resolve().parent

FAULTY: dict[str, str | tuple[str, ...]] = {
    "sys_exit": "exit of {}: the main thread has ended by sys.exit(3) in leave, though the process has not",
    "exit_zero": "exit of {}: status 0 by os._exit(0) in misbehave",
    "exit_status": "crash in {}: exit status 4",
    "raises": 'crash in {}: misbehave: raise ValueError("bad")',
    "deadlock": "hang of {}: in take_first, take_second",
    "livelock": "hang of {}: in wait_for_ever",
    "busy": "hang of {}: in spin",
    "sometimes": 'crash in {}: misbehave: raise ValueError("three times of ten")',
    "lost_worker": "exit of {}: a thread has ended: worker",
    "stdout_traceback": 'crash in {}: misbehave: raise ValueError("bad")',
    "segfaults": (
        "crash in {}: SIGSEGV in poke_large < misbehave < handle",
        "crash in {}: SIGSEGV in poke_not_finite < misbehave < handle",
    ),
    "leaks_much": "growth of {}: memory",
    "leaks_slowly": "growth of {}: memory",
    "leaks_files": "growth of {}: files",
    "ignores": "silent of {}: nothing on state",
    "silent": "silent of {}: nothing on state",
    "not_a_number": "mined finite of state:y",
    "not_a_number_once": "mined finite of state:y",
    "twice": "mined count of state",
    "halves": "mined count of state",
    "wrong_scale": "mined value of state:y",
    "frozen": "mined value of state:y",
    "stale": "mined clock of state:t",
    "stuck_counter": "mined counter of state:n",
}
"""The signatures of the findings of each, with `{}` for its name; a text is the only one."""

ORDER = "order_of_two"
"""Fails on a bad command while the mode is 1, and has a thread for each topic."""

ROBUST = (
    "slow",
    "chatty",
    "refuses",
    "silent_by_design",
    "restarts_thread",
    "muted_by_mode",
    "timers",
    "echoes",
    "sums",
)

_MESSAGES = 30
_STEP_NS = 10_000_000


def write(folder: Path) -> Path:
    """Write riot.toml, the nominal log and the program into a folder; return the path of the former."""
    shutil.copy(FOLDER / "node.py", folder)
    with LogWriter(folder / "nominal.mcap") as log:
        for number in range(_MESSAGES):
            time = 10**18 + number * _STEP_NS
            command = json.dumps({"x": number * 0.5, "k": number % 3}).encode()
            log.write(Message(time, "cmd", command, encoding="application/json"))
            if number % 10 == 4:
                mode = json.dumps({"m": 1 - number // 10 % 2}).encode()
                log.write(Message(time + 1000, "mode", mode, encoding="application/json"))
            if number == _MESSAGES - 5:
                log.write(Message(time + 1000, "mode", b'{"m": 0}', encoding="application/json"))
    parts = ['[system]\nname = "misbehaviour"\nnominal = "nominal.mcap"\n']
    parts += [
        f'[components.{kind}]\ncommand = ["{{python}}", "node.py", "{kind}", "{{endpoint}}"]\n'
        f'inputs = ["cmd", "mode"]\noutputs = ["state"]\nready = {{ timeout = 60 }}\n'
        f'[unit.{kind}]\nleave = ["mode:*", "cmd:k"]\nsettle = {{ timeout = 2.0 }}\n'
        for kind in (*FAULTY, *ROBUST, ORDER)
    ]
    path = folder / "riot.toml"
    path.write_text("\n".join(parts))
    return path
