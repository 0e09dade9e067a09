"""A fork server: a Python process that imports a component's modules once, and forks the component for each start.

The supervisor runs this file as a script, with the component's own interpreter and standard library only, and sends
JSON lines over a socket on file descriptor 0. The first line names the modules to import. Each further line is one
start; the answer is the id of the new process. That process is forked twice, so the supervisor becomes its parent and
is notified of its end as of any other's. It runs the script or module as the interpreter itself would.

Only modules of the standard library, of installed packages and of riot are imported beforehand; each process imports
the component's own modules anew. If importing beforehand would make a difference, nothing is forked, and the answer
says why.
"""

from __future__ import annotations

import ctypes
import gc
import importlib
import importlib.machinery
import importlib.util
import io
import json
import os
import runpy
import signal
import socket
import sys
import types
from collections.abc import Iterable
from contextlib import suppress
from typing import Any, BinaryIO

TYPE_CHECKING = False

INSTALLED = ("site-packages", "dist-packages")
compiled: dict[str, tuple[tuple[int, int, int], types.CodeType]] = {}
RIOT = "riot_bus"
"""Package of riot, which bridges run with its adapters: never code under test, even in an editable installation."""
FIRST = frozenset({"gevent", "eventlet"})  # they patch parts of the standard library before others import these


def load(names: Iterable[str], own: str) -> str:
    """Import the installed ones of some modules; return why nothing can be forked then, empty if it can."""
    wanted = [name for name in names if is_installed(name.partition(".")[0], own)]
    if early := FIRST.intersection(wanted):
        return f"it imports {', '.join(sorted(early))}, which must come before all others"
    if hidden := [name for name in sys.modules if name != "__main__" and is_own(name, own)]:
        return f"it has modules of its own called {', '.join(hidden)}"
    for name in wanted:
        with suppress(BaseException):  # the component gets the same error when it imports the module
            importlib.import_module(name)
    threads = len(os.listdir("/proc/self/task"))
    return "" if threads == 1 else f"its imports start {threads - 1} threads"


def is_own(top: str, own: str) -> bool:
    """Return whether the component has a module of this name, which hides any other."""
    return os.path.exists(os.path.join(own, f"{top}.py")) or os.path.isdir(os.path.join(own, top))


def is_installed(top: str, own: str) -> bool:
    """Return whether a module belongs to the interpreter, to riot or to an installed package, not to the component."""
    if is_own(top, own):
        return False
    if top in sys.stdlib_module_names or top == RIOT or top.startswith(f"{RIOT}_"):
        return True
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):
        return False
    places = [*(spec.submodule_search_locations or ()), spec.origin or ""] if spec else []
    return any(part in INSTALLED for place in places for part in place.split(os.sep))


def program(path: str) -> types.CodeType:
    """Return the compiled code of a script, which is cached until the file changes."""
    with io.open_code(path) as stream:
        told = os.fstat(stream.fileno())
        state = (told.st_ino, told.st_size, told.st_mtime_ns)
        if path not in compiled or compiled[path][0] != state:
            compiled[path] = state, compile(stream.read(), path, "exec", dont_inherit=True)
    return compiled[path][1]


def serve(lines: BinaryIO, link: socket.socket) -> dict[str, Any] | None:
    """Fork a process for each line; return the line in the new process, None when the supervisor is gone."""
    for line in lines:
        request = json.loads(line)
        if request["module"] is None:
            with suppress(OSError, ValueError, SyntaxError):  # the process will say so itself
                program(os.path.join(request["cwd"], request["words"][0]))
        read, write = os.pipe()
        between = os.fork()
        if between == 0:
            between = os.getpid()
            pid = os.fork()
            if pid == 0:
                os.close(read)
                os.close(write)
                link.detach()  # descriptor 0, which is replaced
                return {**request, "between": between}
            os.write(write, b"%d" % pid)
            os._exit(0)
        os.close(write)
        os.waitpid(between, 0)
        answer = {"pid": int(os.read(read, 32))}
        os.close(read)
        link.sendall(json.dumps(answer).encode() + b"\n")
    return None


def become(request: dict[str, Any]) -> None:
    """Set up what a newly started process would have: session, signals, files, folder, environment, arguments."""
    os.setsid()
    while os.getppid() == request["between"]:  # it is ending
        os.sched_yield()
    ctypes.CDLL(None).prctl(1, int(signal.SIGKILL), 0, 0, 0)  # PR_SET_PDEATHSIG
    if os.getppid() != request["parent"]:
        os._exit(1)
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT
    for number, path, how in (
        (0, os.devnull, os.O_RDONLY),
        (1, request["stdout"], flags),
        (2, request["stderr"], flags),
    ):
        file = os.open(path, how, 0o666)
        os.dup2(file, number)
        os.close(file)
    os.chdir(request["cwd"])
    os.environ.clear()
    os.environ.update(request["env"])
    if "RIOT_TRIAL_EVENTS" in os.environ and hasattr(sys.modules.get("sitecustomize"), "watch"):
        sys.modules["sitecustomize"].watch(os.environ["RIOT_TRIAL_EVENTS"], os.environ["RIOT_TRIAL_STACKS"])
    if "numpy.random" in sys.modules:  # `random` does so itself; processes must not draw the same numbers
        sys.modules["numpy.random"].seed()
    sys.orig_argv[:] = request["argv"]


def run(module: str | None, words: list[str]) -> None:
    """Run a module, or the script that is the first word, as the main program."""
    safe = bool(getattr(sys.flags, "safe_path", False))
    main = sys.modules["__main__"] = types.ModuleType("__main__")
    main.__dict__["__builtins__"] = __builtins__
    if module is not None:
        sys.argv[:] = ["-m", *words]
        sys.path[:0] = [] if safe else [os.getcwd()]
        runpy._run_module_as_main(module)  # type: ignore[attr-defined]
        return
    sys.argv[:] = words
    path = os.path.join(os.getcwd(), words[0])  # with `./`, as the interpreter has it
    sys.path[:0] = [] if safe else [os.path.dirname(os.path.realpath(path))]
    code = program(path)
    main.__dict__.update(__file__=path, __loader__=importlib.machinery.SourceFileLoader("__main__", path))
    exec(code, main.__dict__)  # noqa: S102 - the component's own program, as named in riot.toml


def run_as_main(request: dict[str, Any]) -> None:
    """Run the component; print its exceptions as the interpreter would, without the frames of this file."""
    try:
        run(request["module"], request["words"])
    except (SystemExit, KeyboardInterrupt):
        raise
    except BaseException as error:
        trace = error.__traceback__
        while trace is not None and trace.tb_frame.f_code.co_filename == run.__code__.co_filename:
            trace = trace.tb_next
        sys.excepthook(type(error), error.with_traceback(trace), trace)
        raise SystemExit(1) from None


def main() -> None:
    """Serve the socket on file descriptor 0; in each forked process, run the component."""
    if not getattr(sys.flags, "safe_path", False):
        del sys.path[0]  # the folder of this file
    link = socket.socket(fileno=0)
    with os.fdopen(os.dup(0), "rb") as lines:
        first = json.loads(lines.readline())
        why = load(first["modules"], first["own"])
        gc.collect()
        gc.freeze()  # keeps the memory of forked processes shared
        link.sendall(json.dumps({"cannot": why}).encode() + b"\n")
        request = None if why else serve(lines, link)
    if request is not None:
        become(request)
        run_as_main(request)


if __name__ == "__main__":
    main()
