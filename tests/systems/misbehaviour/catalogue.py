"""The kinds of `node.py` and what a test of each must find; `write` makes a system of them."""

from __future__ import annotations

import functools
import json
import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.log.writer import LogWriter
from riot_bus.vocabulary.message import Message

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["FAULTY", "NATIVE", "ORDER", "ROBUST", "build", "missing", "write"]

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
    "leaks_little": "growth of {}: memory",
    "leaks_files": "growth of {}: files",
    "takes_all_memory": "limit of {}: memory",
    "opens_all_files": "limit of {}: files",
    "starts_processes": "limit of {}: processes",
    "runs_for_long": "limit of {}: cpu",
    "ignores": "silent of {}: nothing on state",
    "silent": "silent of {}: nothing on state",
    "last_words": "silent of {}: nothing on state",
    "not_a_number": "mined finite of state:y",
    "not_a_number_once": "mined finite of state:y",
    "twice": "mined count of state",
    "halves": "mined count of state",
    "wrong_scale": "mined value of state:y",
    "frozen": "mined value of state:y",
    "stale": "mined clock of state:t",
    "stuck_counter": "mined counter of state:n",
    "faults_in_c": (
        "crash in {}: SIGSEGV in read_row < misbehave < handle",
        "crash in {}: SIGSEGV in write_row < misbehave < handle",
    ),
    "faults_in_libc": (
        "crash in {}: SIGSEGV in clear_large < misbehave < handle",
        "crash in {}: SIGSEGV in clear_not_finite < misbehave < handle",
    ),
    "twenty_faults": tuple(f"crash in {{}}: SIGSEGV in place_{n} < misbehave < handle" for n in range(6)),
    "overruns": "crash in {}: AddressSanitizer heap-buffer-overflow in read_past",
    "not_finite": "measured:y not finite",
    "stale_stamp": "sequence of measured:n",
    "answers_twice": "count of measured for cmd",
    "keeps_messages": "range of measured:kept",
}
"""The signatures of the findings of each, with `{}` for its name; a text is the only one."""

NATIVE = ("faults_in_c", "faults_in_libc", "twenty_faults", "overruns")
SANITIZED = "overruns"
LIMITED = ("takes_all_memory", "opens_all_files", "starts_processes", "runs_for_long")
MEASURED = ("not_finite", "stale_stamp", "answers_twice", "keeps_messages")
MONITORS = """
[[monitors]]
kind = "finite"
field = "measured:y"
[[monitors]]
kind = "sequence"
field = "measured:n"
modulo = 1_000_000
[[monitors]]
kind = "count"
output = "measured"
input = "cmd"
low = 0.0
high = 1.0
[[monitors]]
kind = "range"
field = "measured:kept"
max = 0
"""
"""What tells the measured kinds, which do nothing that is wrong for all units."""

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
    "homes",
    "caches",
    "records",
)

OUTPUTS = {"homes": ["state", "homed"]}

_MESSAGES = 30
_STEP_NS = 10_000_000


@functools.cache
def sanitizer() -> str:
    """Return the runtime of AddressSanitizer, which comes before all others; empty if there is none."""
    if shutil.which("cc") is None:
        return ""
    command = ["cc", "-print-file-name=libasan.so"]
    path = Path(subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip())
    return str(path) if path.is_absolute() and path.exists() else ""


def missing(kind: str) -> str:
    """Return what this machine lacks to build a kind; empty if nothing."""
    if kind in NATIVE and shutil.which("cc") is None:
        return "a C compiler (cc)"
    return "AddressSanitizer (libasan)" if kind == SANITIZED and not sanitizer() else ""


def build(folder: Path, kind: str, *, above: str = "") -> None:
    """Build what native kinds call, with a sanitizer for the one that is about that, and code above it."""
    if kind in NATIVE:
        sanitize = ["-fsanitize=address"] if kind == SANITIZED else []
        command = [
            "cc",
            "-O1",
            "-g",
            "-w",
            "-shared",
            "-fPIC",
            *sanitize,
            "-x",
            "c",
            "-",
            "-o",
            str(folder / "faults.so"),
        ]
        subprocess.run(command, input=above + (FOLDER / "faults.c").read_text(), text=True, check=True)


def write(folder: Path, kinds: Sequence[str] = (*FAULTY, *ROBUST, ORDER)) -> Path:
    """Write riot.toml, the nominal log and the program into a folder; return the path of the former.

    Args:
        folder: Where.
        kinds: Units that riot.toml describes.
    """
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
    sanitized = f'env = {{ LD_PRELOAD = "{sanitizer()}", ASAN_OPTIONS = "abort_on_error=1:detect_leaks=0" }}\n'
    limited = 'limits = { memory = "1 GiB", processes = 20, cpu = "1.5 s" }\n'
    parts += [
        f'[components.{kind}]\ncommand = ["{{python}}", "node.py", "{kind}", "{{endpoint}}"]\n'
        f'inputs = ["cmd", "mode"]\noutputs = {OUTPUTS.get(kind) or ["measured" if kind in MEASURED else "state"]}\n'
        f"ready = {{ timeout = 60 }}\n{sanitized if kind == SANITIZED else ''}{limited if kind in LIMITED else ''}"
        f"[unit.{kind}]\nleave = {['cmd:k'] if kind == ORDER else ['mode:*', 'cmd:k']}\nsettle = {{ timeout = 2.0 }}\n"
        f"{'mined = false' if kind in MEASURED else ''}\n"
        for kind in kinds
    ]
    path = folder / "riot.toml"
    path.write_text("\n".join(parts) + (MONITORS if set(kinds) & set(MEASURED) else ""))
    return path
