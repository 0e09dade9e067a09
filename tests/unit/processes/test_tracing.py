"""Where a signal ends a process, with real processes built here."""

from __future__ import annotations

import os
import shutil
import signal
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from riot_bus.processes.launcher import ComponentProcess, Launcher
from riot_bus.processes.tracing import AARCH64, X86_64, Machine, unwind
from riot_bus.zenoh.session import wait_until

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="NOT TESTED: native stacks: there is no C compiler")

PROGRAM = r"""
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define KEPT __attribute__((noinline, visibility("default")))
static int (*nowhere)(int);
KEPT int reads(long at) { return *(volatile int *)at + 1; }
KEPT int clears(long at) { memset((void *)at, 0, (size_t)at); return *(volatile char *)at + 1; }
KEPT int fills(long at) { memset((void *)at, 1, (size_t)at); return *(volatile char *)at + 2; }
KEPT int gives_up(long at) { if (at) abort(); return 1; }
KEPT int calls_nowhere(long at) { return nowhere((int)at) + 1; }
KEPT int overflows(long at) { volatile char room[999]; room[0] = 1; return at < 0 ? 0 : overflows(at + 1) + room[0]; }
static void last_words(int number) { signal(number, SIG_DFL); raise(number); }
static void go_on(int number) { (void)number; }
KEPT int survives(long at) {
    signal(SIGSEGV, go_on);
    for (int n = 0; n < 50; n++) raise(SIGSEGV);
    signal(SIGSEGV, SIG_DFL);
    return reads(at) + 1;
}
KEPT int handled(long at) { signal(SIGSEGV, last_words); return clears(at) + 1; }

static const struct { const char *name; int (*call)(long); } FAULTS[] = {
    {"reads", reads}, {"clears", clears}, {"fills", fills}, {"gives_up", gives_up}, {"handled", handled},
    {"calls_nowhere", calls_nowhere}, {"overflows", overflows}, {"survives", survives},
};
static void *fault(void *name) {
    for (size_t n = 0; n < sizeof FAULTS / sizeof *FAULTS; n++)
        if (!strcmp(FAULTS[n].name, name)) FAULTS[n].call(8);
    return NULL;
}
int main(int count, char **words) {
    char byte;
    if (write(1, "ready", 5) != 5) return 2;
    while (access(words[2], F_OK)) usleep(1000);
    if (count > 3) {
        pthread_t thread;
        pthread_create(&thread, NULL, fault, words[1]);
        pthread_join(thread, NULL);
    } else
        fault(words[1]);
    return (int)read(0, &byte, 1);
}
"""
WAIT_S = 30.0
Run = Callable[..., ComponentProcess]


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("native")
    command = ["cc", "-O2", "-fomit-frame-pointer", "-w", "-pthread", "-x", "c", "-", "-o"]
    subprocess.run([*command, str(found / "faults")], input=PROGRAM, text=True, check=True)
    moved = "".join(f"int spare_{n}(int x) {{ return x * {n}; }}\n" for n in range(50)) + PROGRAM
    subprocess.run([*command, str(found / "rebuilt")], input=moved, text=True, check=True)
    subprocess.run(["strip", "-o", str(found / "stripped"), str(found / "faults")], check=True)
    return found


@pytest.fixture
def launcher() -> Iterator[Launcher]:
    with Launcher() as one:
        yield one


@pytest.fixture
def run(launcher: Launcher, folder: Path, tmp_path: Path) -> Run:
    """Run a program, watched, until a signal has ended it."""
    runs: list[str] = []

    def run(*words: str, program: str = "faults") -> ComponentProcess:
        runs.append(program)
        name = f"{program}-{len(runs)}"
        go = tmp_path / f"go-{name}"
        argv = [str(folder / program), words[0], str(go), *words[1:]]
        process = launcher.start(name, argv, env=dict(os.environ), cwd=tmp_path, directory=tmp_path)
        assert wait_until(lambda: process.printed() == "ready", timeout=WAIT_S)
        assert launcher.watch([process.pid]) == ""
        go.touch()
        assert launcher.wait([process], timeout=WAIT_S)
        return process

    return run


def own(process: ComponentProcess) -> list[str]:
    """Return the functions of the program itself down to the one that calls them by name."""
    found = [name for file, name in process.stack if Path(file).name in process.name]
    return found[: found.index("fault")] if "fault" in found else found


@pytest.mark.parametrize("thread", [(), ("thread",)], ids=["main", "thread"])
@pytest.mark.parametrize("kind", ["reads", "clears", "fills", "gives_up", "calls_nowhere", "handled"])
def test_functions_of_the_program_are_told(run: Run, kind: str, thread: tuple[str, ...]) -> None:
    process = run(kind, *thread)
    assert process.status == -(signal.SIGABRT if kind == "gives_up" else signal.SIGSEGV)
    assert own(process) == (["clears", kind] if kind == "handled" else [kind])


def test_a_program_that_is_built_anew_has_the_same_functions(run: Run) -> None:
    before, after = run("clears"), run("clears", program="rebuilt")
    assert [name for _, name in before.stack] == [name for _, name in after.stack]


def test_a_fault_in_a_library_is_told_with_its_file(run: Run) -> None:
    file, _ = run("clears").stack[0]
    assert Path(file).name.startswith("libc")


def test_a_stack_without_end_is_bounded(run: Run) -> None:
    assert own(run("overflows")) == ["overflows"] * 64


def test_signals_that_are_handled_do_not_end_it(run: Run) -> None:
    assert own(run("survives")) == ["reads", "survives"]


def test_functions_without_names_are_told_by_their_offsets(run: Run) -> None:
    told = [own(run(kind, program="stripped"))[0] for kind in ("clears", "fills", "fills")]
    assert all(name.startswith("+0x") for name in told)
    assert told[0] != told[1] == told[2]


def test_what_is_not_watched_ends_as_ever(launcher: Launcher, folder: Path, tmp_path: Path) -> None:
    argv = [str(folder / "faults"), "reads", str(folder)]
    process = launcher.start("part", argv, env=dict(os.environ), cwd=tmp_path, directory=tmp_path)
    assert launcher.wait([process], timeout=WAIT_S)
    assert (process.status, process.stack) == (-signal.SIGSEGV, ())


def test_a_watched_process_takes_other_signals_and_stops_as_ever(launcher: Launcher, tmp_path: Path) -> None:
    code = "import signal; signal.signal(10, lambda *_: print('heard', flush=True)); print('ready', flush=True)\n"
    argv = [sys.executable, "-c", code + "while True: signal.pause()"]
    process = launcher.start("part", argv, env=dict(os.environ), cwd=tmp_path, directory=tmp_path)
    assert wait_until(lambda: process.printed() == "ready\n", timeout=WAIT_S)
    assert launcher.watch([process.pid]) == ""
    launcher.interrupt(process, signal.SIGSTOP)
    assert wait_until(lambda: psutil.Process(process.pid).status() in ("stopped", "tracing-stop"), timeout=WAIT_S)
    launcher.interrupt(process, signal.SIGUSR1)
    launcher.interrupt(process, signal.SIGCONT)
    assert wait_until(lambda: process.printed() == "ready\nheard\n", timeout=WAIT_S)
    launcher.interrupt(process, signal.SIGTERM)
    assert launcher.wait([process], timeout=WAIT_S)
    assert (process.status, process.stack) == (-signal.SIGTERM, ())


def test_what_a_watched_process_starts_and_its_threads_are_killed_with_it(launcher: Launcher, tmp_path: Path) -> None:
    code = "import threading, time\nfor _ in range(9): threading.Thread(target=time.sleep, args=(99,)).start()\n"
    argv = [sys.executable, "-c", code + "print('ready', flush=True)"]
    process = launcher.start("part", argv, env=dict(os.environ), cwd=tmp_path, directory=tmp_path)
    assert wait_until(lambda: process.printed() == "ready\n", timeout=WAIT_S)
    assert launcher.watch([process.pid]) == ""
    launcher.kill_all()
    assert not psutil.pid_exists(process.pid)


def test_a_process_with_a_sanitizer_is_left_alone(launcher: Launcher, tmp_path: Path) -> None:
    """LeakSanitizer refuses to work in a process that is traced."""
    code = '#include <stdlib.h>\n#include <unistd.h>\nint main(void) { char c; write(1, "ready", 5);\n'
    code += (
        '  while (access("go", F_OK)) usleep(1000); for (int n = 0; n < 9; n++) *(volatile char *)malloc(99) = 1; }\n'
    )
    command = ["cc", "-w", "-fsanitize=address", "-x", "c", "-", "-o", str(tmp_path / "leaks")]
    if subprocess.run(command, input=code, text=True, check=False, capture_output=True).returncode:
        pytest.skip("NOT TESTED: native stacks: there is no AddressSanitizer")
    process = launcher.start("part", [str(tmp_path / "leaks")], env=dict(os.environ), cwd=tmp_path, directory=tmp_path)
    assert wait_until(lambda: process.printed() == "ready", timeout=WAIT_S)
    assert launcher.watch([process.pid]) == ""
    (tmp_path / "go").touch()
    assert launcher.wait([process], timeout=WAIT_S)
    assert "LeakSanitizer: detected memory leaks" in process.errors()


@pytest.mark.skipif(os.getuid() != 0, reason="NOT TESTED: a refusal to trace: only root can become somebody else")
def test_what_may_not_be_traced_is_told() -> None:
    code = "import os; from riot_bus.processes.tracing import Tracer; os.setuid(65534); "
    code += "print(Tracer().watch([os.getppid()]))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "Permission denied\n"


@pytest.mark.parametrize("machine", [X86_64, AARCH64])
@pytest.mark.parametrize("value", [0, 8, (1 << 64) - 1, 0x5555_5555_5555_5555])
def test_registers_that_point_nowhere_end_the_stack(machine: Machine, value: int) -> None:
    assert unwind(os.getpid(), struct.pack("<34Q", *[value] * 34), machine) in ([], [("[vsyscall]", "")])


def test_registers_are_known_by_dwarf_numbers() -> None:
    for machine in (X86_64, AARCH64):
        assert {machine.pc, machine.sp} <= set(machine.order)
        assert {machine.pc, machine.sp} <= set(machine.saved[1])


def test_a_process_that_is_gone_is_an_error() -> None:
    with pytest.raises(OSError, match="No such"):
        unwind(1 << 30, bytes(34 * 8), X86_64)
