"""Hook by which a Python component reports in a trial how its main thread ends, and the stacks of its threads.

Python imports this by itself, as riot puts this folder first on the component's PYTHONPATH. It writes JSON lines to the
file that `RIOT_TRIAL_EVENTS` names, and on a signal the stacks of all threads to `RIOT_TRIAL_STACKS` with the process
id appended. Nothing else changes for the component: its own `sitecustomize` is imported as it would be without this.
"""

from __future__ import annotations

import json
import os
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType
    from typing import Any

_FOLDER = os.path.dirname(os.path.abspath(__file__))


def _tell(file: str, **event: object) -> None:
    line = json.dumps({"pid": os.getpid(), **event}).encode() + b"\n"
    try:
        number = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError:  # the trial is over and its folder gone: nothing of this may be seen in the component
        return
    try:
        os.write(number, line)
    finally:
        os.close(number)


def _noted(file: str, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
    def noted(*arguments: Any, **options: Any) -> Any:
        status = next(iter([*arguments, *options.values()]), 0)
        _tell(file, event="exit", call=name, status=repr(status)[:80], function=sys._getframe(1).f_code.co_name)
        return call(*arguments, **options)

    return noted


def _note_imports(file: str) -> None:
    """Write down the name of each module that is imported, one a line, with the process number before it."""
    out = open(file, "a", buffering=1)  # noqa: SIM115 - it stays open

    class Noted:
        @staticmethod
        def find_spec(name: str, *_: object) -> None:
            out.write(f"{os.getpid()} {name}\n")

    sys.meta_path.insert(0, Noted)


def watch(events: str, stacks: str) -> None:
    """Report the end of the main thread and, on a signal, the stacks of all threads.

    Args:
        events: File that gets a JSON line for each event.
        stacks: File, without the process number, that gets stacks.
    """
    import atexit
    import faulthandler
    import signal
    import threading

    sys.exit = _noted(events, "sys.exit", sys.exit)
    os._exit = _noted(events, "os._exit", os._exit)
    # Called when the main thread has come to its end, before other threads are waited for; atexit comes after that.
    register = getattr(threading, "_register_atexit", atexit.register)
    register(lambda: _tell(events, event="main ended"))
    number, safe = signal.SIGRTMAX - 1, signal.SIGRTMAX - 2
    where = open(f"{stacks}.{os.getpid()}", "ab", buffering=0)  # noqa: SIM115 - it stays open
    faulthandler.register(number, file=where, all_threads=True)
    faulthandler.enable()

    def answer(_: int, frame: FrameType | None) -> None:
        # the main thread, in the midst of which this runs, must see nothing of it
        try:  # noqa: SIM105 - nothing more is imported than must be
            where.write(_stacks(frame))
        except Exception:  # noqa: S110
            pass

    try:
        signal.signal(safe, answer)
    except ValueError:  # this is not the main thread of a program that embeds Python
        safe = number
    _tell(events, event="ready", signal=int(number), safe=int(safe))


def _stacks(main: FrameType | None) -> bytes:
    """Return the stacks of all threads in the format of `faulthandler`, which cannot safely read running threads."""
    import threading

    parts = []
    for thread, top in sys._current_frames().items():
        frame = main if thread == threading.main_thread().ident else top
        lines = [f"Thread 0x{thread:016x} (most recent call first):"]
        while frame is not None and len(lines) <= 100:  # as with `faulthandler`
            lines.append(f'  File "{frame.f_code.co_filename}", line {frame.f_lineno} in {frame.f_code.co_name}')
            frame = frame.f_back
        parts.append("\n".join(lines))
    return ("\n\n".join([*parts, "all threads"]) + "\n").encode(errors="replace")


def _chain() -> None:
    """Import the `sitecustomize` that would have been found without this one."""
    import importlib.machinery
    import importlib.util

    rest = [folder for folder in sys.path if os.path.abspath(folder or ".") != _FOLDER]
    found = importlib.machinery.PathFinder.find_spec("sitecustomize", rest)
    if found is not None and found.loader is not None:
        found.loader.exec_module(importlib.util.module_from_spec(found))


try:
    if "RIOT_TRIAL_EVENTS" in os.environ:
        watch(os.environ["RIOT_TRIAL_EVENTS"], os.environ["RIOT_TRIAL_STACKS"])
    if "RIOT_TRIAL_IMPORTS" in os.environ:
        _note_imports(os.environ["RIOT_TRIAL_IMPORTS"])
except OSError:
    pass
_chain()
